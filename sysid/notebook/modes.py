"""The modes of a fit at a prompt and in a notebook."""

from __future__ import annotations

from sysid.base.card import Card
from sysid.base.quantities import pole
from sysid.linear.modes import Modes
from sysid.notebook.poles import pole_table


def line(found: Modes) -> str:
    """The poles, each pair once."""
    few = ", ".join(pole(m.pole) for m in found[:6] if m.pole.imag > -1e-9)
    return f"<Modes: {len(found)} poles{f', {few}' if few else ''}{', ...' if len(found) > 6 else ''}>"


def card(found: Modes) -> Card:
    """The table of poles, and how to have their numbers."""
    table = pole_table(found)
    call = "Next: modes[0].hertz, modes[0].damping, modes[0].time_constant, each with its _std"
    if table is None:
        return Card("Modes", sentences=["The model has no linear block, so it has no poles."])
    return Card("Modes", tables=[table], call=call)

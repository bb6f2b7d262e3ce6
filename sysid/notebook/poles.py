"""The table of poles of a card, and the facts about gain and noise."""

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from sysid.base.card import Table
from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, number
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.linear.modes import Mode, gain, modes
from sysid.linear.noise import Noise, noise_model
from sysid.notebook.doubts import LONGEST, lost

UNKNOWN = "not determined"
HEADINGS = ("pole", "std", "frequency [Hz]", "std", "damping", "std", "time constant [s]", "std")


def modes_of(fit: Fit, data: IOData | None) -> tuple[tuple[Mode, ...], str]:
    """The poles, and what their deviations assume about the residuals."""
    if not len(fit.poles):
        return (), ""
    if data is not None and data.N <= LONGEST:
        with suppress(InputError, np.linalg.LinAlgError):
            return modes(fit, data), "coloured residuals allowed for"
    return modes(fit), "white residuals assumed"


def pole_table(found: Sequence[Mode], how: str = "") -> Table | None:
    """Every pole with its deviations, each pair once; None for a model without a linear block."""
    rows = [_row(m) for m in found if m.pole.imag > -1e-9]
    caption = "Poles with standard deviations"
    return Table(HEADINGS, rows, f"{caption}, {how}" if how else caption) if rows else None


def gain_fact(fit: Fit, data: IOData | None) -> tuple[str, str] | None:
    """The DC gain with its deviation and unit; None for a model that has none."""
    try:
        g = gain(fit, data=data if data is not None and data.N <= LONGEST else None)
    except (InputError, np.linalg.LinAlgError):
        return None
    if not math.isfinite(g.value):
        return "DC gain", "infinite: the model integrates"
    unit = (
        display_quantity("", data.y_unit).per(display_quantity("", data.u_unit))
        if data is not None
        else display_quantity("", "")
    )
    at = f" at u = {number(g.u)}" if g.u else ""
    if lost(g.value, g.std) or (g.value == 0.0 and g.std == 0.0):
        why = "the maps are flat there" if g.value == 0.0 else "its standard deviation is larger than the value"
        return "DC gain", f"{UNKNOWN} at u = {number(g.u)}: {why}"
    spread = f" ± {number(g.std * unit.factor, 2)}" if math.isfinite(g.std) else ", std not determined"
    return "DC gain", f"{number(g.value * unit.factor)}{spread}{f' {unit.unit}' if unit.unit else ''}{at}"


def noise_of(fit: Fit, data: IOData | None) -> Noise | None:
    """The noise model of a record that is not too long, if it has one."""
    if data is None or data.N > LONGEST:
        return None
    try:
        return noise_model(fit, data)
    except (InputError, np.linalg.LinAlgError):
        return None


def _row(m: Mode) -> tuple[str, ...]:
    real, imag = m.pole.real, abs(m.pole.imag)
    text = number(real) if imag < 1e-9 else f"{number(real)} ± {number(imag)}i"
    damping = (number(m.damping), number(m.damping_std, 2))
    lasting = _cells(m.time_constant, m.time_constant_std)
    return text, number(m.pole_std, 2), *_cells(m.hertz, m.hertz_std), *damping, *lasting


def _cells(value: float, std: float) -> tuple[str, str]:
    """A value and its deviation; without numbers where the deviation is larger than the value."""
    return (UNKNOWN, "–") if lost(value, std) else (number(value), number(std, 2))

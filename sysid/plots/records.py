"""A record over time: as recorded, and split into estimation and validation data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.base.units import Quantity, shown
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.plots._runs import first

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def record(data: IOData, axes: Sequence[Axes] | None = None, seconds: float | None = None) -> list[Axes]:
    """Inputs over outputs as recorded, with removed means restored, for the first `seconds` [s] or all samples.

    A panel for each channel; a dotted line is the border of two experiments.
    """
    n, (u, y) = first(data, seconds), _signals(data)
    inputs, outputs = (data.u[:n] + data.u_offset) * u.factor, (data.y[:n] + data.y_offset) * y.factor
    nu, ny = inputs.shape[1], outputs.shape[1]
    rows = style.panels(axes, nu + ny, height=0.8 + 1.4 * (nu + ny), sharex=True)
    for k, ax in enumerate(rows):
        is_input = k < nu
        values = inputs[:, k] if is_input else outputs[:, k - nu]
        style.line(ax, data.t[:n], values, steps=is_input, color=style.INPUT if is_input else style.INK)
        place, of = (k, nu) if is_input else (k - nu, ny)
        what = ("input" if is_input else "output") + (f" {place + 1}" if of > 1 else "")
        ax.set(title=f"({'abcdefghijklmnopqrstuvwxyz'[k % 26]}) {what}", ylabel=(u if is_input else y).label)
        for end in np.cumsum(data.lengths)[:-1]:
            if end < n:
                ax.axvline(end * data.Ts, color=style.SECOND, linewidth=0.8, linestyle=":")
    rows[-1].set(xlabel="time [s]")
    return rows


@checked(own=("axes",))
@styled
def parts(estimation: IOData, validation: IOData, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Input over output with the two parts marked; constants that were removed are added again."""
    estimation, validation = retrend(estimation), retrend(validation)
    u, y = _signals(estimation)
    both = style.panels(axes, 2, height=3.6, sharex=True)
    start = 0.0
    for data, colour, name in ((estimation, style.INK, "estimation"), (validation, style.INPUT, "validation")):
        t = start + data.t
        style.line(both[0], t, data.u[:, 0] * u.factor, steps=True, color=colour, label=name)
        style.line(both[1], t, data.y[:, 0] * y.factor, color=colour)
        start = t[-1] + data.Ts
    both[0].set(title="(a) input", ylabel=u.label)
    both[1].set(title="(b) output", ylabel=y.label, xlabel="time [s]")
    style.legend(both[0])
    return both


def _signals(data: IOData) -> tuple[Quantity, Quantity]:
    return shown(data.u_name, data.u_unit), shown(data.y_name, data.y_unit)

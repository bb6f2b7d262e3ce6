"""A record over time: as recorded, and split into estimation and validation data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.base import style
from sysid.base.style import styled
from sysid.base.units import Quantity, shown
from sysid.data.record import IOData
from sysid.plots._runs import first

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@styled
def record(data: IOData, axes: Sequence[Axes] | None = None, seconds: float | None = None) -> list[Axes]:
    """Input over output as recorded, with removed means restored, for the first `seconds` [s] or all samples."""
    n, (u, y) = first(data, seconds), _signals(data)
    both = style.panels(axes, 2, height=3.6, sharex=True)
    recorded = (data.u[:n, 0] + data.u_offset[0]) * u.factor, (data.y[:n, 0] + data.y_offset[0]) * y.factor
    style.line(both[0], data.t[:n], recorded[0], steps=True, color=style.INPUT)
    style.line(both[1], data.t[:n], recorded[1], color=style.INK)
    both[0].set(title="(a) input", ylabel=u.label)
    both[1].set(title="(b) output", ylabel=y.label, xlabel="time [s]")
    return both


@styled
def parts(estimation: IOData, validation: IOData, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Input over output after preprocessing, with the two parts marked."""
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

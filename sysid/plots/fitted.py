"""Free run of a fit over a record, and what it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.style import styled
from sysid.base.units import percent
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.plots._departure import departure, frame, frame_all
from sysid.plots._runs import output, over

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes", "run", "fits"))
@styled
def fitted(
    data: IOData, run: np.ndarray, fits: Sequence[float], axes: Sequence[Axes] | None = None, skipped: int = 0
) -> list[Axes]:
    """Measured output and free run (N,) or (N, ny), and below it the error of each output.

    `fits` (ny,) are in %; the first `skipped` samples of each experiment give the initial state and are shaded. Where a
    run leaves the data far, the axis is linear over the data and logarithmic beyond.
    """
    y, ny = output(data), data.y.shape[1]
    if len(fits) != ny:
        raise InputError(f"fits has {len(fits)} values for {ny} output(s); give one for each")
    rows = style.panels(axes, 2 * ny, height=0.6 + 3.4 * ny, sharex=True)
    runs, data = over(data, run) + data.y_offset, retrend(data)
    for j in range(ny):
        top, under = rows[2 * j], rows[2 * j + 1]
        measured, model = data.y[:, j] * y.factor, runs[:, j] * y.factor
        error = measured - model
        name = f" {j + 1}" if ny > 1 else ""
        style.line(top, data.t, measured, color=style.INK, label="measured")
        style.line(top, data.t, model, color=style.MODEL, label=f"free run, fit {percent(fits[j])}")
        style.line(under, data.t, error, color=style.SECOND, linewidth=0.9, label="measured minus free run")
        top.set(title=f"output{name}", ylabel=y.label)
        frame_all(top, measured, model)
        under.set(title=f"error{name}", ylabel=y.label)
        under.set_ylim(frame(error)) if departure(measured, model) is None else frame_all(under, measured, error)
        for ax in (top, under):
            ax.margins(x=0.005)
            _shade_starts(ax, data, skipped)
        style.legend(top)
    rows[-1].set(xlabel="time [s]")
    return rows


def _shade_starts(ax: Axes, data: IOData, skipped: int) -> None:
    for start in np.cumsum([0, *data.lengths])[:-1]:
        if skipped:
            ax.axvspan(start * data.Ts, (start + skipped) * data.Ts, color=style.BOUND, lw=0, zorder=0)

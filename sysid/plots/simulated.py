"""A simulated output with its band and the measured output."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.base.units import shown
from sysid.data.record import IOData
from sysid.plots._departure import frame_all
from sysid.plots._shade import level_name, shade
from sysid.uncertainty.bands import OutputBand

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def simulated(band: OutputBand, data: IOData | None = None, axes: Axes | None = None) -> Axes:
    """Free run with its band and the measured output. Long segments of data outside the band show model errors."""
    (ax,) = style.panels(axes, height=3.2)
    y = shown(data.y_name if data is not None else "y", band.unit)
    if data is not None:
        measured = data.y[:, 0] * y.factor
        style.line(ax, data.t, measured, color=style.INK, label="measured")
        frame_all(ax, measured, np.concatenate([band.lower, band.y, band.upper]) * y.factor)
    style.line(ax, band.t, band.y * y.factor, color=style.MODEL, label="free run")
    kind = f"Monte Carlo, {band.draws - band.dropped} draws" if band.draws else "linear"
    name = f"{level_name(band.level)} ({kind})"
    shade(ax, band.t, band.lower * y.factor, band.upper * y.factor, name, band.note)
    ax.set(title="simulated output", xlabel="time [s]", ylabel=y.label, xlim=(band.t[0], band.t[-1]))
    style.legend(ax)
    return ax

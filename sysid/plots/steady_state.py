"""Steady-state output over constant inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.base.units import shown
from sysid.plots._shade import level_name, shade
from sysid.uncertainty.intervals import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def steady_state(band: Band, axes: Axes | None = None, u_unit: str = "", y_unit: str = "") -> Axes:
    """Steady-state output of the whole chain over constant inputs; it does not depend on the gauge."""
    (ax,) = style.panels(axes, height=4.0)
    u, y = shown("u", u_unit), shown("y", y_unit)
    ax.plot(band.x * u.factor, band.value * y.factor, color=style.MODEL, label="steady state")
    lower, upper = band.lower * y.factor, band.upper * y.factor
    shade(ax, band.x * u.factor, lower, upper, level_name(band.level), band.note)
    ax.set(title="steady state", xlabel=u.label, ylabel=y.label)
    style.legend(ax)
    return ax

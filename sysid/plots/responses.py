"""Responses of the linear model that is tangent to a fit, over time."""

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
def step(band: Band, axes: Axes | None = None, y_unit: str = "", u_unit: str = "", y_name: str = "output") -> Axes:
    """Step response of the tangent: its final value is the gain, with the band as its uncertainty."""
    return _response(band, "step", "step response of the tangent model", axes, y_unit, u_unit, y_name)


@checked(own=("axes",))
@styled
def impulse(band: Band, axes: Axes | None = None, y_unit: str = "", u_unit: str = "", y_name: str = "output") -> Axes:
    """Response of the tangent to one sample of 1; the samples before the delay are exactly 0."""
    return _response(
        band, "pulse", "response of the tangent model to a pulse of one sample", axes, y_unit, u_unit, y_name
    )


def _response(band: Band, after: str, title: str, axes: Axes | None, y_unit: str, u_unit: str, y_name: str) -> Axes:
    (ax,) = style.panels(axes)
    y = shown(y_name, y_unit).per(shown("", u_unit))
    # The value stands from its sample to the next one.
    ax.step(band.x, band.value * y.factor, where="post", color=style.MODEL, label="tangent")
    lower, upper = band.lower * y.factor, band.upper * y.factor
    shade(ax, band.x, lower, upper, level_name(band.level), band.note, step="post")
    ax.axhline(0.0, color=style.SECOND, lw=0.5, zorder=0)
    ax.set(title=title, xlabel=f"time after the {after} [s]", ylabel=y.label)
    ax.margins(x=0.01)
    if len(ax.collections):
        style.legend(ax)
    return ax

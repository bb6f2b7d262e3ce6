"""Frequency response of the linear model that is tangent to a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.log_axes import log_axis
from sysid.base.style import styled
from sysid.base.units import shown
from sysid.plots._shade import level_name, shade
from sysid.uncertainty.responses import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def bode(
    response: FrequencyResponse, axes: Sequence[Axes] | None = None, y_unit: str = "", u_unit: str = ""
) -> list[Axes]:
    """Magnitude and phase of the tangent. The band is wide at frequencies where the record has little power."""
    both = style.panels(axes, 2, height=5.2, sharex=True)
    gain, magnitude, phase = shown("magnitude", y_unit).per(shown("", u_unit)), response.magnitude, response.phase
    for ax, band, factor in ((both[0], magnitude, gain.factor), (both[1], phase, 1.0)):
        ax.plot(band.x, band.value * factor, color=style.MODEL, label="tangent")
        shade(ax, band.x, band.lower * factor, band.upper * factor, level_name(band.level), band.note)
    both[0].set(title="frequency response of the tangent model", ylabel=gain.label)
    both[1].set(xlabel="frequency [rad/s]", ylabel="phase [deg]")
    log_axis(both[0])
    log_axis(both[1], "x")
    # A band that is wide at the edge of what was excited must not squeeze the curve into a line.
    size = magnitude.value[magnitude.value > 0] * gain.factor
    both[0].set_ylim(0.3 * size.min(), 3.0 * size.max())
    lo, hi = float(phase.value.min()), float(phase.value.max())
    both[1].set_ylim(lo - 0.2 * (hi - lo) - 10.0, hi + 0.2 * (hi - lo) + 10.0)
    style.legend(both[0])
    return both

"""Responses of the linear model that is tangent to a fit: over time and over frequency, with bands."""

import numpy as np

from sysid.base import style
from sysid.base.units import shown
from sysid.plots._shade import has_area
from sysid.report.words import noted
from sysid.report.zoom import _parts as parts
from sysid.report.zoom._parts import Figure, Row, Trace
from sysid.uncertainty.intervals import Band
from sysid.uncertainty.responses import FrequencyResponse


def step(band: Band, y_unit: str = "", u_unit: str = "", y_name: str = "output") -> Figure:
    """Response to a unit step of the input; its final value is the gain."""
    y = shown(y_name, y_unit).per(shown("", u_unit))
    value = band.value * y.factor
    traces = _with_band(band.x, value, band, y.factor, 0, y.unit, steps=True)
    figure = parts.stacked(traces, [Row(y.label, "step response of the tangent model", 1.8)], "time after the step [s]")
    return _noted(figure, band.note)


def bode(response: FrequencyResponse, y_unit: str = "", u_unit: str = "") -> Figure:
    """Magnitude over phase [deg] against the frequency [rad/s], both with bands."""
    gain = shown("magnitude", y_unit).per(shown("", u_unit))
    magnitude, phase = response.magnitude, response.phase
    traces = _with_band(magnitude.x, magnitude.value * gain.factor, magnitude, gain.factor, 0, gain.unit)
    traces += _with_band(phase.x, phase.value, phase, 1.0, 1, "deg")
    rows = [Row(gain.label, "frequency response of the tangent model", 1.3), Row("phase [deg]")]
    figure = parts.stacked(traces, rows, "frequency [rad/s]")
    layout = figure["layout"]
    layout["xaxis"]["type"] = "log"
    # A band that is wide at the edge of what was excited must not squeeze the curve; a double click shows it whole.
    size = magnitude.value[magnitude.value > 0] * gain.factor
    low, high = np.log10(size.min()), np.log10(size.max())
    layout["yaxis"] |= {"type": "log", "range": [low - 0.5, high + 0.5]}
    low, high = float(phase.value.min()), float(phase.value.max())
    layout["yaxis2"] |= {"range": [low - 0.2 * (high - low) - 10.0, high + 0.2 * (high - low) + 10.0]}
    return _noted(figure, magnitude.note)


def _with_band(
    x: np.ndarray, value: np.ndarray, band: Band, factor: float, row: int, unit: str, steps: bool = False
) -> list[Trace]:
    lower, upper = parts.times(band.lower, factor), parts.times(band.upper, factor)
    seen = has_area(lower, upper)
    traces = list[Trace]()
    if seen:
        area = parts.band(x, lower, upper, f"{100 * band.level:g} % band", row, steps)
        traces.append(area | {"legendgroup": "band", "showlegend": row == 0})
    line = parts.line(x, value, "tangent", style.MODEL, unit, row, steps=steps, legend=row == 0 and seen)
    if np.isfinite(band.std).any():
        line["customdata"] = parts.numbers(upper - band.value * factor)
        line["hovertemplate"] += f" ± %{{customdata:.2g}} ({100 * band.level:g} %)"
    return [*traces, line]


def _noted(figure: Figure, note: str) -> Figure:
    """The figure with the warning of its band, for the page to say."""
    if note:
        figure["layout"]["meta"] = {"said": noted("all of the response", note)}
    return figure

"""What a fit answers to a step, a pulse, a frequency and a constant input, with bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.quantities import Quantity, capital, display_quantity
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Band, Figure, Item, Line, Panel, Rule, has_area, scaled
from sysid.uncertainty import intervals
from sysid.uncertainty.information import UNEXCITED
from sysid.uncertainty.responses import FrequencyResponse
from sysid.uncertainty.spectrum import Spectrum

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(deferred=("axes",))
def step(
    band: intervals.Band, axes: Axes | None = None, y_unit: str = "", u_unit: str = "", y_name: str = "output"
) -> Axes:
    """Step response of the tangent: its final value is the gain, with the band as its uncertainty."""
    return draw(step_figure(band, y_unit, u_unit, y_name), axes)[0]


@checked(deferred=("axes",))
def impulse(
    band: intervals.Band, axes: Axes | None = None, y_unit: str = "", u_unit: str = "", y_name: str = "output"
) -> Axes:
    """Response of the tangent to one sample of 1; the samples before the delay are exactly 0."""
    title = "response of the tangent model to a pulse of one sample"
    return draw(_time_figure(band, "pulse", title, y_unit, u_unit, y_name), axes)[0]


@checked(deferred=("axes",))
def bode(
    response: FrequencyResponse,
    axes: Sequence[Axes] | None = None,
    y_unit: str = "",
    u_unit: str = "",
    model: FrequencyResponse | None = None,
) -> list[Axes]:
    """Magnitude and phase of the tangent, or of a `sysid.spectrum` with its coherence below; a `model` beside it.

    The band is wide at frequencies where the record has little power.
    """
    return draw(bode_figure(response, y_unit, u_unit, model), axes)


@checked(deferred=("axes",))
def steady_state(band: intervals.Band, axes: Axes | None = None, u_unit: str = "", y_unit: str = "") -> Axes:
    """Steady-state output of the whole chain over constant inputs; it does not depend on the gauge."""
    u, y = display_quantity("u", u_unit), display_quantity("y", y_unit)
    items = curve_items(band, "steady state", u.factor, y.factor)
    panel = Panel(items, Axis.of(y), Axis.of(u), "steady state", note=in_small(band.note))
    return draw(Figure([panel], shared=False, height=4.0), axes)[0]


def step_figure(band: intervals.Band, y_unit: str = "", u_unit: str = "", y_name: str = "output") -> Figure:
    """The response to a unit step of the input."""
    return _time_figure(band, "step", "step response of the tangent model", y_unit, u_unit, y_name)


def _time_figure(band: intervals.Band, event: str, title: str, y_unit: str, u_unit: str, y_name: str) -> Figure:
    """A response over time after a step or a pulse."""
    y = display_quantity(y_name, y_unit).per(display_quantity("", u_unit))
    items = [*curve_items(band, "tangent", 1.0, y.factor, steps=True), Rule(0.0, upright=False, width=0.5)]
    time = Axis.time(f"time after the {event} [s]")
    panel = Panel(items, Axis.of(y), time, title, 1.8, in_small(band.note))
    return Figure([panel], said=note_sentences("all of the response", band.note))


def bode_figure(
    response: FrequencyResponse, y_unit: str = "", u_unit: str = "", model: FrequencyResponse | None = None
) -> Figure:
    """Magnitude over phase [deg] against the frequency [rad/s]."""
    gain = display_quantity("magnitude", y_unit).per(display_quantity("", u_unit))
    magnitude, phase = response.magnitude, response.phase
    # A band that is wide at the edge of what was excited must not squeeze the curve into a line.
    size = magnitude.value[magnitude.value > 0] * gain.factor
    y = Axis(gain.label, gain.name, gain.unit, log=True, limits=(0.3 * float(size.min()), 3.0 * float(size.max())))
    x = Axis("frequency [rad/s]", log=True)
    estimated = isinstance(response, Spectrum)
    curve, title = (
        ("estimate", "spectral estimate") if estimated else ("tangent", "frequency response of the tangent model")
    )
    sizes = curve_items(magnitude, curve, 1.0, gain.factor, colour=style.INPUT if model else style.MODEL)
    phases = curve_items(phase, curve, 1.0, 1.0, key=False, colour=style.INPUT if model else style.MODEL)
    if model is not None:
        own = _in_turn(model.phase, phase)
        sizes += curve_items(model.magnitude, "model", 1.0, gain.factor, banded=False)
        phases += curve_items(own, "model", 1.0, 1.0, key=False, banded=False)
    panels = [
        Panel(sizes, y, x, title, 1.3, in_small(magnitude.note)),
        Panel(phases, phase_axis(phase.value), x, note=in_small(phase.note)),
    ]
    if isinstance(response, Spectrum):
        line = Line(magnitude.x, response.coherence, "coherence", style.INPUT if model else style.MODEL, key=False)
        panels.append(Panel([line], Axis.of(Quantity("coherence", ""), (0.0, 1.05)), x))
    return Figure(panels, height=5.2, said=note_sentences("all of the response", magnitude.note))


def noise_figure(noise: intervals.Band, model: np.ndarray, y_unit: str = "") -> Figure:
    """The power of a model's errors over the frequency [rad/s] with its band, and that of its noise model (n,)."""
    y = display_quantity("power", y_unit)
    unit = f"({y.unit})²/Hz" if "/" in y.unit else f"{y.unit}²/Hz" if y.unit else "1/Hz"
    items = curve_items(noise, "estimate", 1.0, y.factor**2, colour=style.INPUT)
    items.append(Line(noise.x, model * y.factor**2, "noise model", style.MODEL))
    shown = noise.value[noise.value > 0.0] * y.factor**2
    limits = (0.1 * float(shown.min()), 10.0 * float(shown.max()))
    axis = Axis(f"power [{unit}]", "power", unit, log=True, limits=limits)
    return Figure([Panel(items, axis, Axis("frequency [rad/s]", log=True), "spectrum of what the model leaves")])


def _in_turn(phase: intervals.Band, beside: intervals.Band) -> intervals.Band:
    """The phase moved by whole turns to where the other one is."""
    apart = np.interp(phase.x, beside.x, beside.value) - phase.value
    turn = 360.0 * np.round(np.median(apart) / 360.0)
    return replace(phase, value=phase.value + turn, lower=phase.lower + turn, upper=phase.upper + turn)


def phase_axis(degrees: np.ndarray) -> Axis:
    """The axis of a phase [deg], in parts of a turn: a band that is wide somewhere does not squeeze the curve."""
    low, high = float(degrees.min()), float(degrees.max())
    air = 0.2 * (high - low) + 10.0
    low, high = low - air, high + air
    step = next((each for each in (15, 30, 45, 90, 180) if high - low <= 6 * each), 360 * np.ceil((high - low) / 2160))
    ticks = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    return replace(Axis.of(Quantity("phase", "deg"), (low, high)), ticks=ticks.tolist())


def curve_items(
    band: intervals.Band,
    label: str,
    x_factor: float,
    factor: float,
    steps: bool = False,
    key: bool = True,
    colour: str = style.MODEL,
    banded: bool = True,
) -> list[Item]:
    """A curve over its band, with the factors of both axes; the curve has a name in the legend if the band has.

    Where the bands of two curves would lie on one another, one of them is not `banded`.
    """
    x, value = band.x * x_factor, scaled(band.value, factor)
    lower, upper = scaled(band.lower, factor), scaled(band.upper, factor)
    area = has_area(lower, upper)
    half = upper - value if np.isfinite(band.std).any() else None
    curve = Line(x, value, label, colour, steps=steps, half=half, key=key and (area or not banded))
    area_item = Band(x, lower, upper, f"{100 * band.level:g} % band", colour, steps=steps, key=key and area)
    return [curve, area_item] if banded else [curve]


def in_small(note: str) -> str:
    """The note of a band as it stands in a panel."""
    return "the record does not excite all of this curve: no band there" if note == UNEXCITED else note


def note_sentences(subject: str, note: str) -> list[str]:
    """A sentence from a note of the intervals of `what`, such as "a pole"; none where there is no note."""
    if note == UNEXCITED:
        return [f"The record does not excite {subject}."]
    return [f"{capital(subject)} {note}."] if note else []

"""The figures of the report of `qpal identify`: one line in `TABLE` each, shown in that order.

The name of a figure is its file name in figures/. Other reports and the app use them too. Nothing here computes a
result; what the figures show comes from an evaluation and the bands about it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sysid.base import style
from sysid.base.poles import ON_CIRCLE
from sysid.base.quantities import Quantity, display_quantity, number, percent, poles
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.drawing.axes import draw
from sysid.drawing.figure import Band, Figure, Rule, scaled
from sysid.drawing.plotly import Plotly, plotly
from sysid.estimation.result import Fit
from sysid.joint.values import distinct_values
from sysid.plots.free_runs import as_outputs, close_ups_figure, runs_figure
from sysid.plots.pole_zero import roots_figure
from sysid.plots.records import parts_figure
from sysid.plots.residual_tests import residuals_figure
from sysid.plots.responses import bode_figure, noise_figure, step_figure
from sysid.plots.static_maps import Words, maps_figure
from sysid.report.bands import GIVES_OUTPUT, SEES_INPUT, bands
from sysid.report.joint import PARTS_SAY, values_figure
from sysid.report.joint import parts_figure as joint_parts_figure
from sysid.report.page import Picture
from sysid.report.sections import one_step
from sysid.report.verdict import shapes_in_words, tests_in_words
from sysid.uncertainty.curves import NORMALISED, Curve
from sysid.workflow.results import Evaluation, single_channels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SectionTitle = Literal["Data", "Model output", "Model", "Spectra", "Residual tests"]
FLAT = 10.0  # times the largest error: a band so wide makes the error a line
VALIDATION_TIME = "time in the validation data [s]"


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report of `qpal identify`, described from an evaluation; other reports may use it.

    `figure` may take options from another report. The axes of a figure name their units, unless it shows only `pure`
    numbers. `tab` is its title as a tab of `qpal app`, which leaves out figures without.
    """

    section: SectionTitle
    figure: Callable[..., Figure]
    caption: Callable[[Evaluation], str]
    applies: Callable[[Evaluation], bool] = lambda e: True
    pure: bool = False
    tab: str = ""

    def draw(self, evaluation: Evaluation) -> list[Axes]:
        """The picture's axes."""
        return draw(self.figure(evaluation))

    def zoom(self, evaluation: Evaluation) -> Plotly:
        """The figure that zooms."""
        return plotly(self.figure(evaluation))

    def picture(self, name: str, evaluation: Evaluation, lead: str = "", **options: Any) -> Picture | None:
        """The figure with its caption after `lead`; None if it does not apply to this model or record."""
        if not self.applies(evaluation):
            return None
        figure = self.figure(evaluation, **options)
        return Picture.of(name, figure, f"{lead}{self.caption(evaluation)}")


def pictures(section: SectionTitle, evaluation: Evaluation) -> list[Picture]:
    """The figures of one section for this evaluation."""
    rows = [(name, figure) for name, figure in TABLE.items() if figure.section == section]
    channels = single_channels(evaluation, section)  # one for each of several outputs
    candidates = (
        figure.picture(name + mark, channel, lead) for name, figure in rows for mark, lead, channel in channels
    )
    return [picture for picture in candidates if picture is not None]


def signals(evaluation: Evaluation) -> tuple[Quantity, Quantity]:
    """Display of input and output."""
    data = evaluation.estimation
    return display_quantity(data.u_name, data.u_unit), display_quantity(data.y_name, data.y_unit)


def _data_figure(e: Evaluation) -> Figure:
    """The record with its parts."""
    return parts_figure(e.estimation, e.validation if e.unseen else None)


def data_caption(e: Evaluation) -> str:
    """The split of the record, and what was done to the values that are shown."""
    has_offsets = e.estimation.u_offset.any() or e.estimation.y_offset.any()
    restoration = " Constants that were removed before the fit are added again, here and in the figures of the output."
    if not e.unseen:
        return f"The record as used, all of it for the fit.{restoration if has_offsets else ''}"
    return (
        f"The record as used: the first {e.estimation.N} samples are estimation data, the other {e.validation.N} "
        f"are validation data.{restoration if has_offsets else ''} What to see: both should go over the same levels, "
        "at the same speeds; else the validation asks for what the fit was not shown."
    )


def joined_figure(e: Evaluation) -> Figure:
    """The free run over both parts, which follow each other in time, with errors, inputs and prediction.

    A click on the run in the legend hides it in all panels; the border of the two parts is a full line.
    """
    if not e.unseen:
        run = as_outputs(e.estimation, e.estimation_output) + e.estimation.y_offset
        return runs_figure(retrend(e.estimation), {f"free run, fit {percent(e.estimation_fit)}, not validated": run})
    record = IOData.merge(retrend(e.estimation), retrend(e.validation))
    figure = _run_over_both(e, record, "free run", e.estimation_output, e.validation_output, e.validation_fit)
    panels, border = list(figure.panels), (e.estimation.N - 0.5) * record.Ts
    if e.band is not None:
        lower, upper = (scaled(edge - e.band.y, signals(e)[1].factor) for edge in (e.band.lower, e.band.upper))
        band = Band(record.t[e.estimation.N :], lower, upper, f"{100 * e.band.level:g} % band of a new measurement")
        close = panels[1]
        panels[1] = replace(close, items=[*close.items, band])
        errors = np.concatenate([line.y for line in close.lines()])
        if close.y.near is None and np.nanmax(upper - lower) > FLAT * np.nanmax(np.abs(errors)):
            largest = record.t[int(np.nanargmax(np.abs(errors)))]
            title = f"error without the band, largest at {largest:.4g} s"
            panels.insert(2, replace(close, title=title))
            figure = replace(figure, height=figure.height + 1.3)
    if e.one_step is not None:
        one, words = e.one_step, "one step ahead, NOT a free run"
        prediction = _run_over_both(e, record, words, one.estimation_output, one.validation_output, one.validation_fit)
        measured, run = prediction.panels[0].lines()
        panels.append(replace(prediction.panels[0], items=[measured, replace(run, colour=style.INPUT)], title=words))
    marks = [mark for mark in figure.marks if isinstance(mark, Rule) and mark.at != border]
    return replace(figure, panels=panels, marks=[*marks, Rule(border, sides=("estimation", "validation"))])


def _run_over_both(
    e: Evaluation, record: IOData, label: str, estimation: np.ndarray, validation: np.ndarray, fit: float
) -> Figure:
    """A run over both parts of the record."""
    pairs = ((e.estimation, estimation), (e.validation, validation))
    run = np.concatenate([as_outputs(data, output) + data.y_offset for data, output in pairs])
    return runs_figure(record, {f"{label}, fit {percent(fit)} in validation": run})


def _free_run_caption(e: Evaluation) -> str:
    """The data used by the free run."""
    band = " The band in the panel of the error says where 95 of 100 new measurements should be." if e.band else ""
    ahead = " The last panel is a one-step-ahead prediction, not a free run: it uses the previous measured outputs."
    return (
        f"Measured output and the model's free-run simulation. It uses only the input and the first {e.fit.n_init} "
        f"outputs of each part for the initial state; these outputs are not scored. What "
        "to see: errors that grow add up in the model; errors in a few places show what it lacks there."
        f"{band}{ahead if e.one_step and e.unseen else ''}"
    )


def _roots_figure(e: Evaluation, references: Mapping[str, np.ndarray] | None = None) -> Figure:
    """Poles, with confidence regions if available, and zeros; `references` are other poles by name."""
    return roots_figure(e.roots or e.poles, e.zeros, references, e.fit.Ts)


def _roots_caption(e: Evaluation) -> str:
    """Whether the model is stable."""
    count = int(np.sum(np.abs(e.poles) >= 1.0 - ON_CIRCLE))
    place = f"{count} pole(s) are on or outside the unit circle" if count else "all poles are inside the unit circle"
    return f"Poles and zeros of the linear block: {place}; the model {e.motion} (poles {poles(e.poles)})."


def _step_figure(e: Evaluation) -> Figure:
    """The response in display units."""
    response = bands(e).step
    assert response is not None
    return step_figure(response, e.estimation.y_unit, e.estimation.u_unit, e.validation.y_name)


def _step_caption(e: Evaluation) -> str:
    """Where the response ends."""
    assert e.step is not None
    u, y = signals(e)
    last = float(e.step.y[-1]) * y.per(u).factor
    goes_on = "" if e.stable else ", and it does not settle"
    return (
        "Step response of the linear model that is tangent to the fit at the mean input: after "
        f"{e.step.x[-1]:.3g} s its value is {number(last, 3)} {y.per(u).unit or 'units of y per unit of u'}"
        f"{goes_on}."
    )


def _bode_figure(e: Evaluation) -> Figure:
    """Magnitude over phase."""
    response = bands(e).frequency
    assert response is not None
    return bode_figure(response, e.estimation.y_unit, e.estimation.u_unit)


def bode_caption(e: Evaluation) -> str:
    """What the band says."""
    response = bands(e).frequency
    assert response is not None
    low, high = response.magnitude.lower, response.magnitude.upper
    unknown = np.mean(~(np.isfinite(low) & np.isfinite(high) & (high < 10.0 * low)))
    doubt = f" At {100 * unknown:.0f} % of the frequencies shown it is wider than a factor of 10: the record does not "
    doubt += "determine the response there."
    subject = "Frequency response of the linear model that is tangent to the fit at the mean input"
    if not np.any(np.isfinite(low) & np.isfinite(high)):
        return f"{subject}, up to half the sampling frequency. The record does not bound the magnitude: it has no band."
    return (
        f"{subject}, with its 95 % band, up to half the sampling frequency. The band is wide where the input of the "
        "record has little power." + (doubt if unknown > 0.005 else "")
    )


def _spectrum_figure(e: Evaluation) -> Figure:
    """The estimate without a model, and the model over it."""
    known = bands(e)
    assert known.spectrum is not None
    return bode_figure(known.spectrum, e.estimation.y_unit, e.estimation.u_unit, known.frequency)


def spectrum_caption(e: Evaluation) -> str:
    """What the estimate is, and what it is not."""
    estimate = bands(e).spectrum
    assert estimate is not None
    return (
        f"Frequency response of the estimation data without a model (Welch, {estimate.parts:.0f} independent parts of "
        f"{estimate.samples} samples) with its 95 % band, and that of the model. The coherence is the share of the "
        "output's power that is linear in the input. What to see: the model inside the band where the coherence is "
        "near 1. Peaks narrower than the estimate resolves come out too low, and feedback biases it."
    )


def _noise_figure(e: Evaluation) -> Figure:
    """The power of what the free run leaves."""
    noise = bands(e).noise
    assert noise is not None
    return noise_figure(*noise, e.estimation.y_unit)


def noise_caption(e: Evaluation) -> str:
    """Whose noise model it is."""
    own = "its own C and D" if isinstance(e.fit, Fit) and e.fit.predicts else "an autoregression of these errors"
    return (
        "Power of the errors of the free run in the estimation data, with its 95 % band, and that of the noise model, "
        f"{own}. What to see: the noise model inside the band; a peak is a disturbance, or dynamics that the model "
        "lacks."
    )


WORDS: dict[str, Words] = {  # by role: title, signal before the map, signal after it
    "input": ("input map", "input u", "into the linear block"),
    "output": ("output map", "out of the linear block", "output y"),
    "middle": ("middle map", "into the map", "out of the map"),
    "driver": ("driver map", "input u", "motor voltage"),
    "map": ("linkage", "actuator's position [strokes]", "output y"),
    "sensor": ("sensor map", "behind linkage and backlash", "output y"),
}
SCALED: dict[str, Words] = {  # the same where the record gives the scale of the signal between the blocks
    "input": ("input map", "input u", "out of the map, on the scale of u"),
    "output": ("output map", "into the map, on the scale of y", "output y"),
    "middle": ("middle map", "into the map, in standard deviations", "out, in standard deviations"),
}


def recorded_maps(e: Evaluation) -> list[Curve]:
    """The maps over signals as recorded: constants that were removed from input and output are added again.

    A normalised map has the outer signal's scale on both sides.
    """
    u, y = (0.0 if len(offset) > 1 else float(offset[0]) for offset in (e.estimation.u_offset, e.estimation.y_offset))
    curves = list[Curve]()
    for curve in bands(e).maps:
        x0, y0 = u * (curve.role in SEES_INPUT), y * (curve.role in GIVES_OUTPUT)
        if curve.scale == NORMALISED:
            x0 = y0 = x0 or y0
        b = curve.band
        band = replace(b, x=b.x + x0, value=b.value + y0, lower=b.lower + y0, upper=b.upper + y0)
        curves.append(replace(curve, band=band))
    return curves


def _maps_figure(e: Evaluation) -> Figure:
    """A panel for each map, in the order of the signal."""
    curves = recorded_maps(e)
    normalised_roles = {c.role for c in curves if c.scale == NORMALISED}
    words = {c.role: (SCALED if c.role in normalised_roles else WORDS).get(c.role, WORDS["middle"]) for c in curves}
    return maps_figure(curves, words)


def _maps_caption(e: Evaluation) -> str:
    """The names, what to see, and the scale of the maps."""
    see = "What to see: on a straight stretch the block is linear; on a level one it passes no change on."
    scale_words = (
        "Only the shape has a meaning: a gain can move between a map and the linear block without changing the model."
    )
    if not e.linear:  # a joint, whose linkage is "map"
        scale_words = ""
    if "map" in e.maps:
        see = (
            "What to see: where the line is steep, the joint turns far for each stroke of its actuator, and its load "
            "weighs more on the motor; a straight line is a constant gear."
        )
        scale_words = "The actuator's stroke runs from 0 at one end stop to 1 at the other."
    elif e.linear and any(curve.scale == NORMALISED for curve in bands(e).maps):
        scale_words += (
            " A signal between the blocks is therefore shown with the mean and deviation of the signal outside; on the "
            "dashed diagonal a map would change nothing."
        )
    names = " and ".join(role.replace("map", "linkage") for role in e.maps)
    words = [f"Static {names} map over the range of the estimation data.", see, *shapes_in_words(e), scale_words]
    return " ".join(words).strip()


def _values_caption(e: Evaluation) -> str:
    """What the points are, and whether some are open."""
    some = any(v.low is None for v in distinct_values(e.values))
    open_ = " Open and grey, with (?) at its name: a number of the model that the record does not determine; the value "
    open_ += "may be anywhere along the row."
    joint = "; voltages are those at mid stroke, with the load" if e.physical else ""
    return (
        f"Physical values (points) with their 95 % intervals (bars){joint}. "
        f"What to see: the shorter the bar, the better the record knows the value.{open_ if some else ''}"
    )


def _parts_figure(e: Evaluation) -> Figure:
    """Each part of a joint beside what is usual."""
    assert e.joint_fit is not None
    return joint_parts_figure(e.joint_fit.parts)


def _parts_caption(_: Evaluation) -> str:
    """What the colours say."""
    return f"Parts of the joint. {PARTS_SAY}"


def _residuals_figure(e: Evaluation) -> Figure:
    """Correlations of the validation residuals with themselves and with the input."""
    assert e.tests is not None
    return residuals_figure(e.tests)


def _residuals_caption(e: Evaluation) -> str:
    """Both test results and their meaning."""
    assert e.tests is not None
    kind = "one step ahead" if one_step(e) else "of the free run"
    see = "What to see: red bars are beyond chance; a test that is passed has none."
    return f"Tests of the residuals of the {e.part} {kind}. {tests_in_words(e)} {see} {e.tests.rule}"


TABLE: dict[str, ReportFigure] = {
    "data": ReportFigure("Data", _data_figure, data_caption),
    "free-run": ReportFigure("Model output", joined_figure, _free_run_caption, tab="Free run"),
    "close-up": ReportFigure(
        "Model output",
        lambda e: close_ups_figure(e.validation, e.validation_output, VALIDATION_TIME if e.unseen else "time [s]"),
        lambda e: (
            f"Close-up of the first whole upper and lower peak of the {e.part}. What to see: whether the free "
            "run turns at the same place and time."
        ),
    ),
    "pole-zero": ReportFigure("Model", _roots_figure, _roots_caption, lambda e: e.linear, pure=True, tab="Poles"),
    "step-response": ReportFigure("Model", _step_figure, _step_caption, lambda e: e.step is not None, tab="Step"),
    "bode": ReportFigure("Model", _bode_figure, bode_caption, lambda e: bands(e).frequency is not None, tab="Bode"),
    "spectrum": ReportFigure(
        "Spectra", _spectrum_figure, spectrum_caption, lambda e: bands(e).spectrum is not None, tab="Spectrum"
    ),
    "noise": ReportFigure("Spectra", _noise_figure, noise_caption, lambda e: bands(e).noise is not None, tab="Noise"),
    "static-maps": ReportFigure("Model", _maps_figure, _maps_caption, lambda e: bool(e.maps), tab="Static maps"),
    "values": ReportFigure(
        "Model", lambda e: values_figure(e.values), _values_caption, lambda e: bool(e.values), tab="Physical values"
    ),
    "parts": ReportFigure(
        "Model",
        _parts_figure,
        _parts_caption,
        lambda e: e.joint_fit is not None and bool(e.joint_fit.parts),
        tab="Parts",
    ),
    "residuals": ReportFigure(
        "Residual tests", _residuals_figure, _residuals_caption, lambda e: e.tests is not None, tab="Residuals"
    ),
}

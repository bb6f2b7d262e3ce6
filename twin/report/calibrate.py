"""The report of `qpal calibrate`: twin and logs before and after, values with intervals, and what is left over."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import display_quantity, estimate, number
from sysid.base.style import styled
from sysid.data.record import IOData
from sysid.drawing.figure import Axis, Band, Figure, Line, Panel, Points
from sysid.plots.free_runs import runs_figure
from sysid.report.answer import short
from sysid.report.page import Grid, Page, Picture, Section
from twin.calibrate import advice
from twin.calibrate.discrepancy import directions
from twin.calibrate.result import Calibration, Run, Score
from twin.report import agreement, leg
from twin.report.calibrate_answer import answer, judged_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def page(result: Calibration, next_step: str = "") -> Page:
    """The report on one calibration; `next_step` is the sentence on what to do then."""
    first = answer(result, _picture(result, judged_run(result), short), next_step)
    others = [_picture(result, k) for k in range(len(result.runs)) if k != judged_run(result)]
    correlations = Picture("correlation", style.png(correlation(result)), _CORRELATION)
    residual_pictures = [
        Picture.of("residuals", residuals_figure(result), _RESIDUALS),
        Picture.of("search", cost_figure(result), _SEARCH),
    ]
    return Page(
        title=f"Calibration of the {result.joint}",
        subtitle=f"{len(result.values)} parameters from {', '.join(result.provenance['logs'])}",
        verdict=sentences(result),
        sections=[
            Section("Twin and logs", tables=[scores(result)], pictures=[*others, _leg(result)]),
            Section("Parameters", [_INTERVALS], tables=[values(result)], pictures=[correlations]),
            *agreement.section(result),
            Section("What the logs tell", undetermined_sentences(result), details=[_identifiability(result)]),
            Section("What is left over", [_LEFT], pictures=residual_pictures),
            Section("Search", [search_sentence(result)]),
        ],
        made_with=versions(),
        answer=first,
    )


def _picture(result: Calibration, k: int, fitted: Callable[[Figure], Figure] = lambda figure: figure) -> Picture:
    """The log of a run with both twins."""
    run = result.runs[k]
    return Picture.of(f"overlay-{k + 1}", fitted(overlay_figure(run)), _caption(run))


_OVERLAY = "{} ({}): log, twin before and twin calibrated in free run, and the two errors."
_BAND = (
    "{} (held out): log, twin before and twin calibrated in free run. Below, the error of the calibrated twin stays in "
    "the band where the twin is as good as the logs that were used let one expect."
)
_SEARCH = "RMS error over the iterations, from the values of column start, which are not those before."
PARTS = 24  # of the travel, each with its mean residual; chosen by hand
_CORRELATION = "Correlation of the estimates: near 1 or -1, an error in one is made up for by the other."
_RESIDUALS = "Log less calibrated twin over the angle, in motion upwards and downwards; lines: mean over a part."
_INTERVALS = (
    "Intervals allow for noise, for departures of the twin from the leg that repeat with place and direction, and for "
    "the parameters that keep their value. The last column is the share of noise alone: a small share means that the "
    "same experiment once more would not make the interval much shorter."
)
_LEFT = "A residual that repeats with place and direction belongs to an effect that the twin does not have."

_ONE_LEG = "The values below take the logs for those of one leg: use them after the next step."


def sentences(result: Calibration) -> list[str]:
    """The result in a few sentences, what must not be used first."""
    runs = agreement.sentences(result)
    texts = [*([*runs[:-1], _ONE_LEG] if result.differing else advice.sentences(result))]
    if result.found.late or not result.converged:
        texts.append(search_sentence(result))
    if result.found.descents > 1:
        texts.append(f"{result.found.agreed} of {result.found.descents} starts led to this place.")
    for score in result.scores:
        texts.append(
            f"{score.log} ({_use(score)}): free run {score.fit_before:.1f} % before, "
            f"{score.fit_after:.1f} % after calibration."
            + ("" if score.inside is None else f" The 95 % band holds {100 * score.inside:.0f} % of its samples.")
        )
    return texts if result.differing else texts + runs


def next_step(result: Calibration) -> str:
    """A value for each log where they differ, else what to do about values that are not determined; empty if none."""
    return agreement.sentences(result)[-1] if result.differing else advice.next_step(result)


def search_sentence(result: Calibration) -> str:
    """How the search ended."""
    iterations = f"{result.found.stop.iterations} iterations"
    if result.converged and not result.found.late:
        return f"The search converged after {iterations}."
    end = "made" if result.found.late else "did not converge after"  # its reason is that it was stopped
    return f"The search {end} {iterations}: {result.reason}."


def _caption(run: Run) -> str:
    return (_OVERLAY if run.half is None else _BAND).format(run.name, _use(run))


def _use(item: Run | Score) -> str:
    return "held out" if item.held_out else "used"


def undetermined_sentences(result: Calibration) -> list[str]:
    """Parameters that these logs do not tell, each with what to record."""
    wide = {row: f"{row}: {reason}." for row, reason in advice.undetermined_rows(result).items()}
    reasons = wide | dict(result.fixed)
    if not reasons:
        return ["These logs tell every parameter that was free."]
    return [f"{reason} To tell it, {advice.what_to_record(result.joint, row)}." for row, reason in reasons.items()]


def tables(result: Calibration) -> list[Grid]:
    """What the console shows."""
    by_log = [agreement.by_log(result)] if result.by_run else []
    return [values(result), *by_log, scores(result)]


def values(result: Calibration) -> Grid:
    """Calibrated values beside the nominal ones."""
    rows = []
    for v in result.values:
        q = display_quantity(v.name, v.unit)
        nominal, start = (number(q.factor * x, 4) for x in (v.nominal, v.start))
        value, low, high = estimate(*(q.factor * x for x in (v.value, v.low, v.high)))
        noise = f"{100 * v.noise_share:.0f} %"
        rows.append((v.name, q.unit or "–", nominal, start, value, f"{low} to {high}", noise))
    heading = f"{100 * result.level:g} % interval"
    return Grid(("parameter", "unit", "before", "start", "calibrated", heading, "noise"), rows, text_columns=2)


def scores(result: Calibration) -> Grid:
    """Free runs over every log."""
    rows = [
        (
            score.log,
            _use(score),
            *(number(float(np.degrees(rms)), 3) for rms in (score.rms_before, score.rms_after)),
            *(f"{fit:.2f} %" for fit in (score.fit_before, score.fit_after)),
            number(None) if score.inside is None else f"{100 * score.inside:.0f} %",
        )
        for score in result.scores
    ]
    headings = ("log", "", "RMS before [deg]", "RMS after [deg]", "fit before", "fit after", "inside the band")
    return Grid(headings, rows, text_columns=2)


def _identifiability(result: Calibration) -> Grid:
    """What the logs tell of each parameter, before the search."""
    rows = []
    for row in result.told:
        q = display_quantity(row.name, row.unit)
        deviation, scale = (number(q.factor * v, 3) for v in (row.expected, row.scale))
        verdict = "yes" if row.told else "no"
        rows.append((row.name, q.unit or "–", deviation, scale, verdict, ", ".join(row.alike)))
    headings = ("parameter", "unit", "expected deviation", "plausible change", "told", "acts like")
    return Grid(headings, rows, "Before the search", text_columns=2, last_text=True)


def overlay_figure(run: Run) -> Figure:
    """Log and both free runs over time, with their errors and the input below; the error of a log that was not used
    within its band."""
    data = IOData(run.u, run.y, run.Ts, "input", "angle", "V", "rad", missing=~np.isfinite(run.y))
    models = {"twin calibrated": run.after, "twin before": run.before}
    figure = runs_figure(data, models, "log", (style.MODEL, style.SECOND))
    first, errors, *rest = figure.panels
    if run.half is not None:
        half = np.degrees(run.half)
        band = Band(data.t, -half, half, "95 % band", style.MODEL)
        line = Line(data.t, np.degrees(run.y - run.after), "twin calibrated", style.MODEL, 1.0, key=False)
        errors = Panel([band, line], Axis("error [deg]"), Axis.time(), "error, log minus calibrated twin", 0.8)
    return replace(figure, panels=[replace(first, title=run.name), errors, *rest])


def _leg(result: Calibration) -> Picture:
    """The log and the calibrated twin, as legs with the calibrated lengths."""
    run = next((run for run in result.runs if run.held_out), result.runs[0])
    sides = {"log": {result.joint: run.y}, "calibrated twin": {result.joint: run.after}}
    return leg.picture("leg", np.arange(len(run.y)) * run.Ts, sides, result.parameters)


@styled
def correlation(result: Calibration) -> "Axes":
    """The correlation matrix with its numbers."""
    (ax,) = style.panels(None, height=4.2)
    names = [value.name.rpartition(".")[2] for value in result.values]
    image = ax.imshow(result.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    ax.figure.colorbar(image, ax=ax, label="correlation", ticks=[-1.0, -0.5, 0.0, 0.5, 1.0])
    for (i, j), r in np.ndenumerate(result.correlation):
        ax.text(j, i, f"{r:.2f}", ha="center", va="center", fontsize=7, color="white" if abs(r) > 0.6 else style.INK)
    ax.set_xticks(range(len(names)), names, rotation=40, ha="right")
    ax.set_yticks(range(len(names)), names)
    ax.grid(False)
    return ax


def residuals_figure(result: Calibration) -> Figure:
    """Residual over the angle, one panel for each direction of motion."""
    runs = [run for run in result.runs if not run.held_out]
    y, e = np.concatenate([run.after for run in runs]), np.concatenate([run.y - run.after for run in runs])
    way, moves = (np.concatenate(parts) for parts in zip(*(directions(run.after, run.Ts) for run in runs), strict=True))
    edges = np.linspace(y.min(), y.max(), PARTS + 1)
    part = np.clip(np.digitize(y, edges) - 1, 0, PARTS - 1)
    panels = []
    for direction, title in ((1.0, "upwards"), (-1.0, "downwards")):
        mask = moves & (way == direction) & np.isfinite(e)
        means = [np.mean(e[mask & (part == k)]) if np.any(mask & (part == k)) else np.nan for k in range(PARTS)]
        samples = Points(np.degrees(y[mask]), np.degrees(e[mask]), "samples", style.SECOND, key=False)
        mean = Line(np.degrees((edges[1:] + edges[:-1]) / 2), np.degrees(means), "mean", key=False)
        panels.append(Panel([samples, mean], Axis("log less twin [deg]"), Axis("angle [deg]"), title))
    return Figure(panels, columns=2, shared=False, height=2.8)


def cost_figure(result: Calibration) -> Figure:
    """RMS error over iterations, from the start on."""
    samples = sum(int(np.isfinite(run.y).sum()) for run in result.runs if not run.held_out)
    losses = np.array([result.found.first / samples, *(row["loss"] for row in result.found.history)])
    line = Line(np.arange(len(losses)), np.degrees(np.sqrt(losses)), "RMS error", dots=True, key=False)
    ticks = np.unique(np.linspace(0, len(losses) - 1, 8).round()).tolist()
    return Figure([Panel([line], Axis("RMS error [deg]", log=True), Axis("iteration", ticks=ticks))], height=2.2)

"""The report of `qpal calibrate`: twin and logs before and after, values with intervals, and what is left over."""

from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.log_axes import log_axis
from sysid.base.style import styled
from sysid.base.units import number, shown
from sysid.base.versions import versions
from sysid.data.record import IOData
from sysid.report import zoom
from sysid.report.page import Grid, Page, Picture, Section
from twin.calibrate import doubt
from twin.calibrate.advice import what_to_record
from twin.calibrate.discrepancy import directions
from twin.calibrate.result import Calibration, Run
from twin.report import leg

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def page(result: Calibration) -> Page:
    """The report on one calibration."""
    overlays = [_overlay(run, k) for k, run in enumerate(result.runs)]
    return Page(
        title=f"Calibration of the {result.joint}",
        subtitle=f"{len(result.values)} parameters from {', '.join(result.provenance['logs'])}",
        verdict=verdict(result),
        sections=[
            Section(
                "Twin and logs",
                tables=[scores(result)],
                pictures=[*overlays, _leg(result)],
            ),
            Section("Parameters", [_INTERVALS], tables=[values(result)], pictures=[_correlation(result)]),
            Section("What the logs tell", sentences(result), details=[_told(result)]),
            Section("What is left over", [_LEFT], pictures=[_residuals(result), _cost(result)]),
        ],
        made_with=versions(),
    )


_INTERVALS = (
    "Intervals allow for noise, for departures of the twin from the leg that repeat with place and direction, and for "
    "the parameters that keep their value. The last column is the share of noise alone: a small share means that the "
    "same experiment once more would not make the interval much shorter."
)
_LEFT = "A residual that repeats with place and direction belongs to an effect that the twin does not have."


def verdict(result: Calibration) -> list[str]:
    """The result in a few sentences, what must not be used first."""
    said = [
        *doubt.sentences(result),
        f"The search {'converged' if result.converged else 'did not converge'} after {result.found.stop.iterations} "
        f"iterations: {result.reason}.",
    ]
    if result.next_step():
        said.append(result.next_step())
    if result.found.descents > 1:
        said.append(f"{result.found.agreed} of {result.found.descents} starts led to this place.")
    for score in result.scores:
        said.append(
            f"{score.log} ({'held out' if score.held_out else 'used'}): free run {score.fit_before:.1f} % before, "
            f"{score.fit_after:.1f} % after calibration."
        )
    return said


def sentences(result: Calibration) -> list[str]:
    """Parameters that these logs do not tell, each with what to record."""
    if not result.fixed:
        return ["These logs tell every parameter that was free."]
    return [f"{said} To tell it, {what_to_record(result.joint, row)}." for row, said in result.fixed.items()]


def tables(result: Calibration) -> list[Grid]:
    """What the console shows."""
    return [values(result), scores(result)]


def values(result: Calibration) -> Grid:
    """Calibrated values beside the nominal ones."""
    rows = []
    for value in result.values:
        as_shown = shown(value.name, value.unit)
        cells = [
            number(as_shown.factor * v, 4) for v in (value.nominal, value.start, value.value, value.low, value.high)
        ]
        unit = as_shown.unit or "–"
        rows.append((value.name, unit, *cells[:3], f"{cells[3]} to {cells[4]}", f"{100 * value.noise_share:.0f} %"))
    heading = f"{100 * result.level:g} % interval"
    return Grid(("parameter", "unit", "before", "start", "calibrated", heading, "noise"), rows, text_columns=2)


def scores(result: Calibration) -> Grid:
    """Free runs over every log."""
    rows = [
        (
            score.log,
            "held out" if score.held_out else "used",
            number(float(np.degrees(score.rms_before)), 3),
            number(float(np.degrees(score.rms_after)), 3),
            f"{score.fit_before:.2f} %",
            f"{score.fit_after:.2f} %",
        )
        for score in result.scores
    ]
    headings = ("log", "", "RMS before [deg]", "RMS after [deg]", "fit before", "fit after")
    return Grid(headings, rows, text_columns=2)


def _told(result: Calibration) -> Grid:
    rows = []
    for row in result.told:
        as_shown = shown(row.name, row.unit)
        expected, scale = (number(as_shown.factor * v, 3) for v in (row.expected, row.scale))
        rows.append(
            (row.name, as_shown.unit or "–", expected, scale, "yes" if row.told else "no", ", ".join(row.alike))
        )
    headings = ("parameter", "unit", "expected deviation", "plausible change", "told", "acts like")
    return Grid(headings, rows, "Before the search", text_columns=2, last_text=True)


def _overlay(run: Run, k: int) -> Picture:
    kind = "held out" if run.held_out else "used"
    caption = f"{run.name} ({kind}): log, uncalibrated and calibrated twin in free run, and the two errors."
    data = IOData(run.u, run.y, run.Ts, "input", "angle", "V", "rad", missing=~np.isfinite(run.y))
    zoomed = zoom.runs(data, {"twin calibrated": run.after, "twin before": run.before}, measured="log")
    return Picture(f"overlay-{k + 1}", style.png(overlay(run)), caption, zoomed)


def _leg(result: Calibration) -> Picture:
    """The log and the calibrated twin, as legs with the calibrated lengths."""
    run = next((each for each in result.runs if each.held_out), result.runs[0])
    sides = {"log": {result.joint: run.y}, "calibrated twin": {result.joint: run.after}}
    return leg.picture("leg", np.arange(len(run.y)) * run.Ts, sides, result.parameters)


@styled
def overlay(run: Run) -> "list[Axes]":
    """Log and both free runs over time, and their errors below."""
    above, below = style.panels(None, rows=2, height=4.2, sharex=True)
    t = np.arange(len(run.y)) * run.Ts
    style.line(above, t, np.degrees(run.y), color=style.INK, label="log", linewidth=1.0)
    style.line(above, t, np.degrees(run.before), color=style.SECOND, label="twin before", linewidth=1.0)
    style.line(above, t, np.degrees(run.after), color=style.MODEL, label="twin calibrated", linewidth=1.0)
    style.line(below, t, np.degrees(run.y - run.before), color=style.SECOND, linewidth=0.8)
    style.line(below, t, np.degrees(run.y - run.after), color=style.MODEL, linewidth=0.8)
    above.set(ylabel="angle [deg]", title=run.name)
    style.legend(above)
    below.set(xlabel="time [s]", ylabel="log less twin [deg]")
    return [above, below]


def _correlation(result: Calibration) -> Picture:
    caption = "Correlation of the estimates: near 1 or -1, an error in one is made up for by the other."
    return Picture("correlation", style.png(correlation(result)), caption)


@styled
def correlation(result: Calibration) -> "Axes":
    """The correlation matrix with its numbers."""
    (ax,) = style.panels(None, height=4.2)
    names = [value.name.rpartition(".")[2] for value in result.values]
    drawn = ax.imshow(result.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    ax.figure.colorbar(drawn, ax=ax, label="correlation", ticks=[-1.0, -0.5, 0.0, 0.5, 1.0])
    for (i, j), r in np.ndenumerate(result.correlation):
        ax.text(j, i, f"{r:.2f}", ha="center", va="center", fontsize=7, color="white" if abs(r) > 0.6 else style.INK)
    ax.set_xticks(range(len(names)), names, rotation=40, ha="right")
    ax.set_yticks(range(len(names)), names)
    ax.grid(False)
    return ax


def _residuals(result: Calibration) -> Picture:
    caption = "Log less calibrated twin over the angle, in motion upwards and downwards; lines: mean over a part."
    return Picture("residuals", style.png(residuals(result)), caption)


_PARTS = 24


@styled
def residuals(result: Calibration) -> "list[Axes]":
    """Residual over the angle, one panel for each direction of motion."""
    used = [run for run in result.runs if not run.held_out]
    axes = style.panels(None, columns=2, height=2.8)
    y, e = np.concatenate([run.after for run in used]), np.concatenate([run.y - run.after for run in used])
    way, moves = (np.concatenate(each) for each in zip(*(directions(run.after, run.Ts) for run in used), strict=True))
    edges = np.linspace(y.min(), y.max(), _PARTS + 1)
    for ax, direction, title in zip(axes, (1.0, -1.0), ("upwards", "downwards"), strict=True):
        mine = moves & (way == direction) & np.isfinite(e)
        ax.plot(np.degrees(y[mine]), np.degrees(e[mine]), ".", color=style.SECOND, markersize=1.5)
        part = np.clip(np.digitize(y, edges) - 1, 0, _PARTS - 1)
        means = [np.mean(e[mine & (part == k)]) if np.any(mine & (part == k)) else np.nan for k in range(_PARTS)]
        ax.plot(np.degrees((edges[1:] + edges[:-1]) / 2), np.degrees(means), color=style.MODEL)
        ax.set(xlabel="angle [deg]", ylabel="log less twin [deg]", title=title)
    return axes


def _cost(result: Calibration) -> Picture:
    return Picture("search", style.png(cost(result)), "RMS error over the iterations of the search.")


@styled
def cost(result: Calibration) -> "Axes":
    """RMS error over iterations, from the start on."""
    (ax,) = style.panels(None, height=2.2)
    scored = sum(int(np.isfinite(run.y).sum()) for run in result.runs if not run.held_out)
    losses = [result.found.first / scored, *(row["loss"] for row in result.found.history)]
    ax.plot(range(len(losses)), np.degrees(np.sqrt(losses)), "o-", color=style.MODEL, markersize=3)
    log_axis(ax, "y")
    ax.locator_params(axis="x", integer=True)
    ax.set(xlabel="iteration", ylabel="RMS error [deg]")
    return ax

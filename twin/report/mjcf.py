"""The report of `qpal calibrate --model`: logs and model before and after, values, and what they leave open."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import display_quantity, estimate, number, percent
from sysid.diagnosis.worth import worth
from sysid.drawing.figure import Axis, Figure, Line, Panel
from sysid.plots.free_runs import over_panel
from sysid.report.answer import POOR, Answer, Word
from sysid.report.page import Grid, Page, Picture, Section
from twin.mjcf.calibration import LEVEL, RobotCalibration, Run, Value
from twin.mjcf.writing import file_name

USED, HELD = "used", "held out"
MANY = 4  # values that a sentence names
WIDE = 3.2  # width of the log's line
MISSING = "–"  # no value of the logs' own
_SEE = (
    "{}: log, and the model before and after calibration in free run, over each other; below, what is left. A good "
    "calibration lies on the log{}."
)
_WRITTEN = (
    "{} is the calibrated MJCF, changes.diff what changed in it, ranges.toml means, deviations and covariance for "
    "randomisation."
)
_WITHHELD = "No calibrated MJCF is written; ranges.toml holds what was found."


def page(result: RobotCalibration, next_step: str) -> Page:
    """The report on one calibration; `next_step` is the sentence on what to do then."""
    pictures = [
        Picture.of(f"joint-{k}", figure(runs), _SEE.format(runs[0].drive, _beside(runs)))
        for k, runs in enumerate(_by_drive(result), 1)
    ]
    run, drives = _judged(result), [drive.name for drive in result.robot.drives]
    picture = pictures.pop(drives.index(run.drive))
    return Page(
        title=f"Calibration of {result.robot.path.name}",
        subtitle=f"{len(result.values)} parameters of {len(result.robot.drives)} joint(s)",
        verdict=sentences(result),
        sections=[
            Section("Values", tables=[values(result)]),
            Section("Model and logs", tables=[scores(result)], pictures=pictures),
        ],
        made_with=versions(),
        answer=Answer(
            percent(run.fit("after")),
            f"of {run.log} ({HELD if run.held_out else USED}) explained at {run.drive}; "
            f"{percent(run.fit('before'))} before",
            word(result),
            _sentence(result),
            picture,
            values=values(result).only("parameter", "unit", "calibrated", f"{100 * LEVEL:g} % interval"),
            next=next_step,
        ),
    )


def _judged(result: RobotCalibration) -> Run:
    """The run that judges: of those that were held out the one that fell most, else the worst."""
    unseen = [run for run in result.runs if run.held_out]
    if result.worse:
        return max(result.worse, key=lambda run: run.rms("after") / run.rms("before"))
    return min(unseen or result.runs, key=lambda run: run.fit("after"))


def word(result: RobotCalibration) -> Word:
    """As `worth` says; sound if a held-out log judged it and nothing is open or lacking; poor also if the model may not
    be used."""
    if not result.usable or not result.optimum.stop.converged:
        return POOR
    is_open = any(not value.determined for value in result.values) or result.lacking is not None
    run = _judged(result)
    return worth(run.fit("after"), run.tests, run.held_out and not is_open)


def _sentence(result: RobotCalibration) -> str:
    """Why the word."""
    count, run = f"{len(result.determined)} of {len(result.values)} values are determined", _judged(result)
    if result.worse:
        return f"Do not use the calibrated model: {_fall(run)}."
    if not result.determined:
        return "These logs determine none of the values, so the model stays as it is."
    return f"{count}; {_fall(run)}."


def _beside(runs: Sequence[Run]) -> str:
    return ", on the held-out log beside it too" if any(run.held_out for run in runs) else ""


def _by_drive(result: RobotCalibration) -> list[list[Run]]:
    """For each drive its first used run, and its first held-out one."""
    out = []
    for drive in result.robot.drives:
        runs = [run for run in result.runs if run.drive == drive.name]
        firsts = (next((run for run in runs if run.held_out is held), None) for held in (False, True))
        out.append([run for run in firsts if run is not None])
    return out


def figure(runs: Sequence[Run], names: tuple[str, str] = ("before", "after"), state: str = "") -> Figure:
    """The runs side by side: readings above, errors below; `names` of both models, and of the `state` of all logs."""
    above, below = [], []
    for run in runs:
        quantity = display_quantity("position", run.unit)
        t, models = np.arange(len(run.y)) * run.Ts, dict(zip(names, (run.before, run.after), strict=True))
        colours = (style.SECOND, style.MODEL)
        title = f"{run.log}, {state or (HELD if run.held_out else USED)}"
        panel = over_panel(t, run.y, models, quantity, title, (), colours, "log")
        log, *others = panel.lines()  # a good run lies on the log: a thin line on a wide one, so that both are seen
        above.append(replace(panel, items=[replace(log, width=WIDE), *(replace(line, width=1.0) for line in others)]))
        errors = [
            Line(t, quantity.factor * (run.y - each), name, colour, 1.0, key=False)
            for (name, each), colour in zip(models.items(), colours, strict=True)
        ]
        below.append(Panel(errors, Axis(f"log less model [{quantity.unit}]"), Axis.time()))
    return Figure([*above, *below], columns=len(runs), shared=False, height=3.2)


def sentences(result: RobotCalibration) -> list[str]:
    """The result in a few sentences, the verdict first."""
    stop, texts = result.optimum.stop, [_verdict(result)]
    open_values = [value.name for value in result.values if not value.determined]
    if open_values:
        texts.append(
            f"Not determined: {', '.join(open_values)}. The logs tell less than one bit about each: it stays as in "
            f"{result.robot.path.name}, and its interval is what they leave of what is plausible for such a joint."
        )
    if run := result.lacking:
        texts.append(
            f"{run.drive} departs from the model by {number(run.left, 2)} times the noise of its readings ({run.log}): "
            "the robot does something that the model lacks, and the intervals may be too narrow."
        )
    moved = [value for value in result.determined if not value.low <= value.continuous <= value.high]
    if moved:
        moved.sort(key=lambda value: -abs(value.continuous - value.value) / abs(value.value or 1.0))
        step = number(1e3 * float(result.robot.model.opt.timestep), 3)
        names = ", ".join(f"{value.name} {' '.join(_shown(value, value.continuous)[:2])}" for value in moved[:MANY])
        texts.append(
            f"The values are those for the time step of {result.robot.path.name}, {step} ms, which takes part in the "
            f"motion: with much shorter steps they would be {names}{', ...' if len(moved) > MANY else ''}."
        )
    if not stop.converged:
        texts.append(f"The search did not converge: {stop.reason}.")
    texts += [*result.robot.notes, *result.remarks]
    texts.append(_WRITTEN.format(file_name(result.robot)) if result.usable else _WITHHELD)
    return texts


def _verdict(result: RobotCalibration) -> str:
    count = f"{len(result.determined)} of {len(result.values)} values are determined"
    if result.worse:
        run = max(result.worse, key=lambda run: run.rms("after") / run.rms("before"))
        return f"Do not use the calibrated model: {_fall(run)} on {run.log}, which was held out ({run.drive}); {count}."
    if not result.determined:
        return "These logs determine none of the values, so the model stays as it is."
    unseen = [run for run in result.runs if run.held_out]
    run = _judged(result)
    kind = "which was held out" if unseen else "which was used; give another kind of log with --hold-out to judge it"
    worst = "" if len(result.robot.drives) == 1 else " at the worst joint"
    return f"{count}, and{worst} {_fall(run)} on {run.log} ({run.drive}), {kind}."


def _fall(run: Run) -> str:
    q = display_quantity("", run.unit)
    before, after = (number(q.factor * run.rms(name), 3) for name in ("before", "after"))
    return f"the error of the free run goes from {before} to {after} {q.unit}"


def tables(result: RobotCalibration) -> list[Grid]:
    """What the console shows."""
    return [values(result), scores(result)]


def values(result: RobotCalibration) -> Grid:
    """Values before and after."""
    heading = f"{100 * LEVEL:g} % interval"
    rows = [_row(value) for value in result.values]
    before = f"in {result.robot.path.name}"
    return Grid(("parameter", "unit", before, "calibrated", heading, "bits", ""), rows, text_columns=2, last_text=True)


def _shown(value: Value, x: float) -> tuple[str, str, float]:
    """x as a person reads it, the unit, and the factor to it; gains and friction stay per rad, as in MJCF."""
    angle = value.unit == "rad"
    q = display_quantity(value.name, value.unit if angle else "1")
    return number(q.factor * x, 4), q.unit if angle else value.unit, q.factor


def _row(value: Value) -> tuple[str, ...]:
    before, unit, factor = _shown(value, value.before)
    now, low, high = estimate(*(factor * x for x in (value.value, value.low, value.high)))
    state = "" if value.determined else "not determined"
    bits = number(max(value.learned, 0.0), 2)
    return value.name, unit, before, now if value.determined else MISSING, f"{low} to {high}", bits, state


def scores(result: RobotCalibration) -> Grid:
    """Free runs over every log."""
    rows = []
    for run in result.runs:
        q = display_quantity("", run.unit)
        errors = (f"{number(q.factor * run.rms(name), 3)} {q.unit}" for name in ("before", "after"))
        fits = (f"{run.fit(name):.2f} %" for name in ("before", "after"))
        rows.append((run.log, run.drive, HELD if run.held_out else USED, *errors, *fits))
    return Grid(("log", "actuator", "", "RMS before", "RMS after", "fit before", "fit after"), rows, text_columns=3)

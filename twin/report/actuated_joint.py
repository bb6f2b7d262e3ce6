"""The part of `qpal reproduce` that the paper has not: an actuated joint, the paper's structure and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.quantities import display_quantity, number, percent
from sysid.base.style import styled
from sysid.drawing.figure import Axis, Bars, Figure, Item, Line, Panel, Rule
from sysid.joint.values import JointValue
from sysid.report import sections
from sysid.report.page import Grid, Picture, Section
from sysid.workflow.results import Evaluation
from twin.studies import ablation
from twin.studies.ablation import DIVERGES, Ablation, Row
from twin.studies.beyond import NEAR, RECORDS, RecoveredValue, Trial
from twin.studies.protocol import JointResult, ProtocolResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

SHOWN = {"shoulder": 12.0, "thigh": 60.0, "shank": 60.0}  # [s] of the validation half
WORDS = {"sweep": "the paper's sweep", "drawn sweep": "a sweep with random times and levels"}
MARKS = {"sweep": ("o", style.INPUT), "drawn sweep": ("s", style.MODEL)}
FRAME = 4.0  # half width of the figure of recovered values, in multiples of the aim


def section(result: ProtocolResult) -> Section:
    """Fits, recovered values and figures of all joints."""
    pictures = [picture(r) for r in result.joints]
    pictures.append(Picture("beyond-recovered", style.png(recovery(result)), _RECOVERY))
    return Section("Beyond the paper", [_WHY, *sentences(result)], [table(result), values_table(result)], pictures)


_WHY = (
    "A joint driven by a voltage integrates, and rests at its end stops. A Hammerstein-Wiener model has no end stop; "
    "it fits the paper's sweep only because that sweep repeats itself. This section compares the same structure, "
    "with the paper's orders, maps and search, with an actuated joint: motor with friction, two end stops, linkage, "
    "backlash. Both are fitted to the first half of the paper's sweep and of a sweep with random times and levels, "
    "which does not repeat itself. Both are then simulated in free run over the second half. The actuated joint uses "
    "no starting values and no numbers of the twin."
)
_RECOVERY = (
    "Identified value minus truth for both records, divided by the accepted error (column aim of the table), with 95 "
    f"% intervals. Grey: within the aim. An arrow marks a value beyond {FRAME:g} aims, a hollow mark a value without "
    "an interval. The end stops are those of the drive; the link rests within half the backlash, and the "
    "potentiometer is nonlinear."
)


def sentences(result: ProtocolResult) -> list[str]:
    """The outcome in plain words."""
    texts = []
    for k, record in enumerate(RECORDS):
        trials = [(r.joint, r.beyond.trials[k]) for r in result.joints]
        fits = ", ".join(
            f"{joint} {percent(t.joint.validation_fit)} ({percent(t.paper.validation_fit)})" for joint, t in trials
        )
        close_count = sum(t.near for _, t in trials)
        texts.append(
            f"On {WORDS[record]} the actuated joint reaches, with the paper's structure in brackets: {fits}. It comes "
            f"within {NEAR:g} point of the ceiling on {close_count} of {len(trials)} joints."
        )
    return texts


def table(result: ProtocolResult) -> Grid:
    """The paper's row of every joint, then both structures on both records."""
    rows: list[tuple[str, ...]] = []
    quiet = set()
    for r in result.joints:
        rows.append((r.joint, "the rig, 2016", "paper", f"{r.paper.validation_fit:.2f} %", "–", "–", "–"))
        quiet.add(len(rows) - 1)
        for t in r.beyond.trials:
            rows += [_row(r.joint, t, "paper's structure", t.paper), _row(r.joint, t, "actuated joint", t.joint)]
    headings = ("joint", "record", "model", "fit", "ceiling", f"within {NEAR:g} of ceiling", "d")
    return Grid(headings, rows, text_columns=3, quiet_rows=frozenset(quiet))


def _row(joint: str, t: Trial, model: str, e: Evaluation) -> tuple[str, ...]:
    is_close = "yes" if e.validation_fit >= t.ceiling - NEAR else "no"
    return joint, t.record, model, percent(e.validation_fit), percent(t.ceiling), is_close, str(e.fit.criteria.d)


_NONE = ("–", "–")


def values_table(result: ProtocolResult) -> Grid:
    """Truth, aim, and the values from both records with 95 % intervals."""
    rows = []
    for r in result.joints:
        for value in r.beyond.recovered:
            unit = display_quantity(sections.WORDS.get(value.name, value.name), value.unit)
            cells = [sections.value_cells(value.found[name])[:2] if name in value.found else _NONE for name in RECORDS]
            rows.append(
                (
                    r.joint,
                    unit.label,
                    number(value.true * unit.factor, 4),
                    number(value.aim * unit.factor, 2),
                    *(cell for pair in cells for cell in pair),
                )
            )
    headings = ("joint", "value", "truth", "aim ±", *(h for name in RECORDS for h in (name, "95 % interval")))
    return Grid(headings, rows, "Physical values that the actuated joint recovered", text_columns=2)


def picture(r: JointResult) -> Picture:
    """Free runs of both structures on both records."""
    paper, joint = ([percent(getattr(t, side).validation_fit) for t in r.beyond.trials] for side in ("paper", "joint"))
    caption = (
        f"{r.joint.capitalize()}: free runs over the validation half of both records, and the errors on the second. "
        f"The fit of the paper's structure falls from {' to '.join(paper)}, the actuated joint reaches "
        f"{' and '.join(joint)}."
    )
    return Picture.of(f"beyond-{r.joint}", free_runs_figure(r.beyond.trials, SHOWN[r.joint]), caption)


def free_runs_figure(trials: Sequence[Trial], seconds: float) -> Figure:
    """Measured angle and both free runs over the first `seconds` [s] of the validation half, then the last's errors."""
    time = Axis.time("time in the validation half [s]")
    panels = []
    for t in trials:
        v = t.joint.validation
        part = slice(min(v.N, max(2, round(seconds / v.Ts))))
        angle = np.degrees(v.y[part, 0])
        items = [Line(v.t[part], angle, "measured", style.INK, 2.2)]
        fits = " and ".join(percent(e.validation_fit) for e, *_ in _models(t))
        for e, colour, name in _models(t):
            run = np.degrees(e.validation_output[part] + e.validation.y_offset[0])
            items.append(Line(v.t[part], run, name, colour, 1.1))
        pad = 0.25 * float(np.ptp(angle))
        limits = float(angle.min()) - pad, float(angle.max()) + pad
        panels.append(
            Panel(items, Axis("angle [deg]", "angle", "deg", limits=limits), time, f"{t.record}, fits {fits}")
        )
    errors = [
        Line(v.t[part], np.degrees(e.validation.y[part, 0] - e.validation_output[part]), name, colour, 1.0, key=False)
        for e, colour, name in _models(trials[-1])
    ]
    error = Axis("error [deg]", "error", "deg")
    panels.append(Panel(errors, error, time, f"errors on {WORDS[trials[-1].record]}"))
    return Figure(panels, height=6.4, lettered=True)


def _models(t: Trial) -> tuple[tuple[Evaluation, str, str], ...]:
    return (t.paper, style.INPUT, "paper's structure"), (t.joint, style.MODEL, "actuated joint")


@styled
def recovery(result: ProtocolResult) -> Sheet:
    """Every value that some record determines less its truth, in aims, a panel for each joint."""
    figure, axes = style.sheet(1, len(result.joints), height=3.6)
    names = {value.name for r in result.joints for value in r.beyond.recovered if value.found}
    for ax, r in zip(axes[0], result.joints, strict=True):
        values = [value for value in r.beyond.recovered if value.name in names]
        ax.axvspan(-1, 1, color="#e4e7eb", zorder=0)
        ax.axvline(0, color=style.SECOND, linewidth=1.0)
        for row, value in enumerate(values):
            for record, shift in zip(RECORDS, (-0.16, 0.16), strict=True):
                if record in value.found:
                    _dot(ax, value, value.found[record], row + shift, *MARKS[record])
        words = [sections.WORDS.get(value.name, value.name) for value in values]
        ax.set_yticks(range(len(values)), words if ax is axes[0, 0] else [""] * len(values))
        ax.set(xlim=(-FRAME - 0.3, FRAME + 0.3), title=r.joint, xlabel="error divided by aim")
        ax.set_ylim(len(values) - 0.5, -0.5)
    for record in RECORDS:
        axes[0, 0].plot([], [], MARKS[record][0], color=MARKS[record][1], markersize=4, label=WORDS[record])
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def _dot(ax: Axes, value: RecoveredValue, estimate: JointValue, row: float, mark: str, colour: str) -> None:
    """A recovered value with its interval, in aims from the truth."""
    true = value.true

    def scale(x: float) -> float:
        return float(np.clip((x - true) / value.aim, -FRAME, FRAME))

    x = scale(estimate.value)
    if abs(x) == FRAME:
        mark = ">" if x > 0 else "<"
    face = "white"
    if estimate.low is not None and estimate.high is not None:
        ax.plot([scale(estimate.low), scale(estimate.high)], [row, row], color=colour, linewidth=1.6)
        face = colour
    ax.plot([x], [row], mark, color=colour, markersize=4, markerfacecolor=face)


def ablation_section(result: ProtocolResult) -> Section | None:
    """The loss without each part and the gain without each imperfection; None if this was not requested."""
    ablations = [a for r in result.joints for a in r.ablation]
    if not ablations:
        return None
    return Section(
        "Causes of the losses",
        [_ABLATION, *ablation_sentences(ablations)],
        [parts_table(ablations), imperfections_table(ablations)],
        [Picture.of("ablation", bars_figure(ablations), _BARS)],
    )


_ABLATION = (
    "The paper attributes the errors of its models to friction, backlash and disturbance. The twin can test this in "
    "two ways: the actuated joint is fitted again without each of its parts, and the paper's structure is fitted to "
    "the twin without each of its imperfections, under the same excitation and noise."
)
_BARS = (
    "Points of fit on the validation half. Model without: loss of the actuated joint without a part. Twin without: "
    "gain of the paper's structure on the twin without an imperfection; fits below 0 % count as 0 % there, because a "
    "structure without end stops gives a different poor model each time."
)


def ablation_sentences(ablations: Sequence[Ablation]) -> list[str]:
    """The most important part on each record, and the effect of the most important imperfection."""
    texts = []
    for a in ablations:
        main = max((row for row in a.joint if row.fit is not None), key=a.points_lost)
        single = [row for row in a.paper if row.fit is not None and row.part in a.single]
        best = max(single, key=a.points_gained)
        fits = [row.fit for row in a.paper if row.part == ablation.BARE and row.fit is not None]
        text = f" With all imperfections off but the end stops it reaches {percent(fits[0])}." if fits else ""
        texts.append(
            f"{a.name.capitalize()}, {a.record}: without its {main.part} the actuated joint loses "
            f"{a.points_lost(main):.1f} points. The paper's structure is {a.behind:.1f} points behind; switching "
            f"off a single imperfection of the twin improves it by at most "
            f"{max(a.points_gained(best), 0.0):.1f} points ({_words(best.part)}).{text}"
        )
    return texts


def parts_table(ablations: Sequence[Ablation]) -> Grid:
    """Points that the actuated joint loses without each part."""
    rows = [["nothing left out: fit", *(percent(a.joint_fit) for a in ablations)]]
    for part in [row.part for row in ablations[0].joint]:
        rows.append([part, *(_points(a, a.joint, part, a.points_lost) for a in ablations)])
    return Grid(_headings(ablations), rows, "Points of fit that the actuated joint loses without a part")


def imperfections_table(ablations: Sequence[Ablation]) -> Grid:
    """Fit of the paper's structure on the twin without each imperfection."""
    rows = [["the twin as it is", *(percent(a.paper_fit) for a in ablations)]]
    for part in [row.part for row in ablations[0].paper]:
        fits = (next((row.fit for row in a.paper if row.part == part), None) for a in ablations)
        rows.append([_words(part), *("leaves the range" if fit is None else percent(fit) for fit in fits)])
    return Grid(_headings(ablations), rows, "Fit of the paper's structure on the twin without an imperfection")


def _headings(ablations: Sequence[Ablation]) -> tuple[str, ...]:
    return ("without", *(f"{a.name}, {a.record}" for a in ablations))


def _points(a: Ablation, rows: Sequence[Row], part: str, points) -> str:
    row = next((row for row in rows if row.part == part), None)
    if row is not None and row.reason == DIVERGES:
        return DIVERGES
    return "–" if row is None or row.fit is None else f"{points(row):.2f}".replace("-", "−")


def _words(part: str) -> str:
    return part.replace("_", " ")


def bars_figure(ablations: Sequence[Ablation]) -> Figure:
    """Losses of the actuated joint on the left, gains of the paper's structure on the right, one colour per joint."""
    panels = []
    for record in RECORDS:
        of_record = [a for a in ablations if a.record == record]
        joints, papers = (
            [(a.joint, a.points_lost) for a in of_record],
            [(a.paper, a.points_gained) for a in of_record],
        )
        panels.append(_bars_panel(of_record, joints, f"model without, {record}", "points lost"))
        panels.append(_bars_panel(of_record, papers, f"twin without, {record}", "points gained"))
    return Figure(panels, columns=2, shared=False, height=8.4, legend="below")


def _bars_panel(ablations: Sequence[Ablation], sides: list, title: str, unit: str) -> Panel:
    """Points by part, a bar for each joint."""
    parts = [row.part for row in sides[0][0]]
    height = 0.8 / len(ablations)
    items: list[Item] = [Rule(0.0)]
    for k, (a, (rows, points), colour) in enumerate(
        zip(ablations, sides, (style.INK, style.INPUT, style.MODEL), strict=False)
    ):
        by_name = {row.part: points(row) for row in rows}
        shift = (k - 0.5 * (len(ablations) - 1)) * height
        values = [by_name.get(part, np.nan) for part in parts]
        items.append(Bars(values, a.name, (colour,), width=height, shift=shift))
    return Panel(items, Axis(names=[_words(part) for part in parts]), Axis(unit), title)

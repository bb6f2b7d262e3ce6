"""The report of `qpal rig auto`: each value before and after, and its interval from experiment to experiment."""

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import display_quantity, estimate, number
from sysid.drawing.figure import Axis, Figure, Item, Panel, Ranges, Rule
from sysid.joint.values import WORDS, JointValue
from sysid.plots.records import record_figure
from sysid.report.page import Grid, Page, Picture, Section
from twin.rig.auto import Campaign

_CAPTION = (
    "Each value with its 95 % interval after each experiment; an open mark is not determined yet. An interval stays "
    "where no later record narrows it."
)
_TRUE = " The dashed line is the truth, which the emulated rig has hidden until now."


def page(result: Campaign) -> Page:
    """The report on a campaign with one experiment or more."""
    caption = _CAPTION + ("" if result.truth is None else _TRUE)
    intervals = Picture.of("intervals", figure(result), caption, zooms=False)
    records = [
        Picture.of(
            f"record-{k}",
            record_figure(done.log.io()),
            f"Experiment {k}: {done.what}, as it was played. To zoom in it: qpal info experiment-{k}.csv --out record",
            zooms=False,
        )
        for k, done in enumerate(result.rounds, start=1)
    ]
    return Page(
        title=f"The rig's {result.joint}",
        subtitle=f"{len(result.rounds)} experiments, {result.rig_seconds:.0f} s of rig time",
        verdict=sentences(result),
        sections=[
            Section("Values", tables=tables(result), pictures=[intervals]),
            Section("Records", pictures=records),
        ],
        made_with=versions(),
    )


def sentences(result: Campaign) -> list[str]:
    """What is determined, and what was lost on the way."""
    known = len(result.asked) - len(result.open)
    texts = [
        f"{known} of {len(result.asked)} values are determined after {len(result.rounds)} experiments and "
        f"{result.rig_seconds:.0f} s of rig time."
    ]
    if result.open:
        names = ", ".join(WORDS[name] for name in result.open)
        texts.append(f"Not determined: {names}. {result.stopped[:1].upper()}{result.stopped[1:]}.")
    for k, done in enumerate(result.rounds, start=1):
        texts += [f"Experiment {k}: {note}." for note in done.log.meta["notes"]]
    if result.truth is not None:
        final = result.values_after(len(result.rounds))
        judged = [name for name in result.asked if name in result.truth and name not in result.open]
        holding = sum(final[name].holds(result.truth[name]) for name in judged)
        texts.append(f"The rig was emulated: {holding} of {len(judged)} intervals hold the truth.")
    return texts


def tables(result: Campaign) -> list[Grid]:
    """The values after the first and after the last experiment, beside the truth of an emulated rig."""
    first, final = result.values_after(1), result.values_after(len(result.rounds))
    headings = ["value", "unit", "first experiment", "all experiments"] + (["truth"] if result.truth else [])
    rows = []
    for name in result.asked:
        if name in final:
            q = display_quantity(name, final[name].unit)
            cells = [WORDS[name], q.unit, _cell(first.get(name)), _cell(final[name])]
            truth = "–" if not result.truth or name not in result.truth else number(q.factor * result.truth[name], 3)
            rows.append([*cells, *([truth] if result.truth else [])])
    return [Grid(headings, rows, text_columns=2)]


def _cell(value: JointValue | None) -> str:
    if value is None:
        return "–"
    q = display_quantity(value.name, value.unit)
    if value.low is None or value.high is None:
        return "not determined"
    found, low, high = estimate(*(q.factor * x for x in (value.value, value.low, value.high)))
    return f"{found} ({low} to {high})"


def figure(result: Campaign) -> Figure:
    """A panel for each asked value: its interval after each experiment, and the truth of an emulated rig."""
    names = [f"after {k}" for k in range(1, len(result.rounds) + 1)]
    after = [result.values_after(k) for k in range(1, len(names) + 1)]
    panels = []
    for name in result.asked:
        rows = [(k, known[name]) for k, known in enumerate(after) if name in known]
        if rows:
            panels.append(_panel(name, rows, names, result))
    height = 0.8 + -(-len(panels) // 2) * (1.1 + 0.22 * len(names))
    return Figure(panels, columns=2, shared=False, height=height, legend="below")


def _panel(name: str, rows: list[tuple[int, JointValue]], names: list[str], result: Campaign) -> Panel:
    q = display_quantity(name, rows[0][1].unit)
    items: list[Item] = []
    if result.truth is not None and name in result.truth:
        items.append(Rule(q.factor * result.truth[name], dash="dash", label="truth"))
    told = [(k, v.value, v.low, v.high) for k, v in rows if v.low is not None and v.high is not None]
    if told:
        places, *numbers = zip(*told, strict=True)
        value, low, high = ((q.factor * np.array(each)).tolist() for each in numbers)
        items.append(Ranges(list(places), value, low, high, "95 % interval", colour=style.MODEL))
    guessed = [(k, q.factor * v.value) for k, v in rows if v.low is None]
    if guessed:
        label = "not determined"
        items.append(Ranges([k for k, _ in guessed], [x for _, x in guessed], label=label, colour=style.INPUT))
    return Panel(items, Axis(names=names), Axis(f"{WORDS[name]} [{q.unit}]"), WORDS[name])

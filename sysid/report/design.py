"""The page of `qpal design`: the next experiment, and what it would tell."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import capital, display_quantity, number
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel, Rule, Span
from sysid.joint.design import TARGETS, Design, Phase
from sysid.joint.sampling import response_samples
from sysid.joint.use import Use
from sysid.joint.values import JointValue, distinct_values
from sysid.plots.records import Signal, stack_figure
from sysid.report.answer import GOOD, POOR, USABLE, Answer, Word
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.sections import WORDS, value_cells
from sysid.workflow.design import Proposal

COLOURS = (style.MODEL, *style.COLOURS[2:4])


def page(result: Proposal, file: str) -> Page:
    """The whole report; `file` has the input."""
    d = result.design
    caption = (
        "Input, and the output that the first fit predicts. The bands are the parts of the experiment. The position of "
        "the real joint may differ, so before every slow part the input drives it to an end stop, if one is known."
    )
    data = result.record.data
    picture = Picture.of("experiment", experiment_figure(d, data.u_name, data.y_name), caption)
    told, (now, then) = values(d), asked(d)
    first = Answer(
        f"{_determined(then)} of {len(distinct_values(then))}",
        f"{'values' if then == d.then else 'values that were asked for'} are expected to be determined by this "
        f"experiment; the first record determines {_determined(now)}",
        word(d),
        f"{_to_do(result, file)}.",
        picture,
        values=told.only("", "now", "expected", "unit"),
        next=f"Next, with the new record: {result.command}",
    )
    return Page(
        "The next experiment",
        f"{', '.join(d.targets)}; designed on {result.record.path.name}",
        sentences(result, file),
        [
            Section("Experiment", tables=[phases(d)]),
            *([] if d.use is None else [use_section(d, data.y_name)]),
            *([Section("On your input", [f"{capital(d.no_use)}."])] if d.no_use else []),
            Section("What it would tell", tables=[values(d)]),
        ],
        versions(),
        answer=first,
    )


def _determined(values: Sequence[JointValue]) -> int:
    """How many values a record determines."""
    return sum(v.determined for v in distinct_values(values))


def asked(d: Design) -> tuple[tuple[JointValue, ...], tuple[JointValue, ...]]:
    """The values now and with the experiment: all, or those of its targets where it has not all of them."""
    names = [name for target in d.targets for name in TARGETS[target]]
    if d.use is not None or set(d.targets) == set(TARGETS):
        return d.now, d.then
    now, then = (tuple(v for v in side if v.name in names) for side in (d.now, d.then))
    return (now, then) if then else (d.now, d.then)


def word(d: Design) -> Word:
    """Good if the experiment determines all values asked for, poor if it determines no more than the first record."""
    values_asked = asked(d)
    now, then = map(_determined, values_asked)
    if then == len(distinct_values(values_asked[1])):
        return GOOD
    helps = then > now or (d.use is not None and d.use.deviations[1] < d.use.deviations[0])
    return USABLE if helps else POOR


def _to_do(result: Proposal, file: str) -> str:
    """What to do with the input."""
    d = result.design
    largest = f"{np.abs(d.u).max():.3g} {d.units[0]}".rstrip()
    return (
        f"Apply the input in {file} ({d.duration:.0f} s, up to {largest}) to the joint, and record input and output "
        f"every {d.Ts:g} s"
    )


def sentences(result: Proposal, file: str) -> list[str]:
    """What to do, and what was assumed."""
    d = result.design
    return [
        f"{_to_do(result, file)}, {_why_so_often(result)}.",
        f"The joint moves at {d.fastest * result.speed.factor:.3g} {result.speed.unit} at most, also when it meets an "
        f"end stop. To limit the speed, give --strike in the unit of the log, {result.strike_unit}.",
        *([] if d.use is None else [_use_sentence(d)]),
        *([f"{capital(d.no_use)}."] if d.no_use else []),
        *(f"{capital(note)}." for note in d.notes),
    ]


def _why_so_often(result: Proposal) -> str:
    """The reason for the sampling time of the experiment."""
    first, lasts = result.record.data.Ts, response_samples(result.fit.model, result.fit.theta) * result.fit.Ts
    response = f"lag and delay of the joint together, {lasts:.2g} s,"
    if result.design.use is not None:
        return "as the first record, with which it is identified"
    if result.design.Ts < first:
        return f"in place of {first:g} s: {response} then last {lasts / result.design.Ts:.1f} samples"
    return f"as the first record: {response} last {lasts / first:.1f} samples"


def use_section(d: Design, y_name: str) -> Section:
    """The deviation of the free run over the input of use, now and with the experiment."""
    assert d.use is not None
    caption = (
        "(a) Expected deviation of the model's free run from the joint over the input of use, with the first record "
        "alone and with the experiment. (b) Its mean after each part of the experiment. What to see: where the line is "
        "level, more time of the rig brings little."
    )
    return Section("On your input", pictures=[Picture.of("use", use_figure(d.use, d.units[1], y_name), caption)])


def use_figure(use: Use, unit: str, y_name: str) -> Figure:
    """Deviations over the input of use, and their mean over the time of the rig."""
    quantity = display_quantity("deviation", unit)
    times = np.arange(len(use.u)) * use.Ts
    rig, means = np.array(use.steps).T
    sides = (("with the first record", use.now, style.SECOND), ("with the experiment", use.then, style.MODEL))
    over_time = [Line(times, quantity.factor * values, name, colour) for name, values, colour in sides]
    steps: list[Item] = [
        Line(rig, quantity.factor * means, "mean after each part", dots=True),
        Rule(0.0, upright=False),
    ]
    y = Axis.of(quantity)
    panels = [
        Panel(over_time, y, Axis.time("time in the input of use [s]"), f"expected deviation of {y_name}"),
        Panel(steps, y, Axis.time("time of the rig [s]"), "its mean over the input of use"),
    ]
    return Figure(panels, 1, shared=False, height=5.6, lettered=True)


def tables(result: Proposal) -> list[Grid]:
    """What a terminal shows."""
    return [phases(result.design), values(result.design)]


def _use_sentence(d: Design) -> str:
    assert d.use is not None
    quantity = display_quantity("deviation", d.units[1])
    now, then = (number(quantity.factor * deviation, 2) for deviation in d.use.deviations)
    return (
        f"Over the input of use the model is expected to be off by {now} {quantity.unit} on the mean now, and by "
        f"{then} {quantity.unit} with the experiment, as far as the joint is like the model."
    )


def phases(d: Design) -> Grid:
    """The parts of the experiment."""
    rows = [(p.name, f"{p.start * d.Ts:.1f} to {p.stop * d.Ts:.1f}", p.why) for p in _parts(d)]
    return Grid(("part", "time [s]", "what happens"), rows, "Parts of the experiment", last_text=True)


def _parts(d: Design) -> list[Phase]:
    """The phases, neighbours of one name as one."""
    groups = [list(group) for _, group in groupby(d.phases, key=lambda p: p.name)]
    return [replace(group[0], stop=group[-1].stop) for group in groups]


def values(d: Design) -> Grid:
    """The joint's values now, and with the experiment."""
    first, second = ({v.name: v for v in distinct_values(side)} for side in (d.now, d.then))
    rows = []
    for name in (name for name in WORDS if name in first or name in second):
        cells = [value_cells(side[name])[:2] if name in side else ("–", "–") for side in (first, second)]
        unit = value_cells(second.get(name) or first[name])[2]
        # Where the first record does not determine a value, the fit does not say where it will be.
        prediction = cells[1][1] if name in first and first[name].determined else _half(second.get(name), cells[1][1])
        rows.append((WORDS.get(name, name.replace("_", " ")), *cells[0], prediction, unit))
    caption = (
        "Values from the first record, and the 95 % intervals expected from the new record if the joint behaves like "
        "the fitted model (± is half an interval, about a value that the first record does not show)"
    )
    return Grid(("", "now", "95 % interval now", "expected", "unit"), rows, caption, last_text=True)


def _half(value: JointValue | None, otherwise: str) -> str:
    """The half width of an interval."""
    if value is None or value.low is None or value.high is None:
        return otherwise
    half = 0.5 * (value.high - value.low) * display_quantity(value.name, value.unit).factor
    return f"± {number(half, 2)}"


def experiment_figure(d: Design, u_name: str = "input u", y_name: str = "y") -> Figure:
    """Input and predicted output over time, with the parts of the experiment as areas."""
    signals = [
        Signal(display_quantity(u_name, d.units[0]), d.u, "input", style.INPUT, steps=True),
        Signal(display_quantity(f"predicted {y_name}", d.units[1]), d.y, "predicted output", style.MODEL),
    ]
    names = list(dict.fromkeys(p.name for p in d.phases))
    marks = [
        Span(p.start * d.Ts, p.stop * d.Ts, label=p.name, colour=COLOURS[names.index(p.name) % len(COLOURS)])
        for p in _parts(d)
    ]
    figure = stack_figure(np.arange(len(d.u)) * d.Ts, signals)
    return replace(figure, height=4.4, lettered=False, marks=marks)

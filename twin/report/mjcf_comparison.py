"""The report of `qpal compare --model`: log and model, what departs, which kinds of parameters explain it."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import capital, display_quantity, number
from sysid.drawing.figure import Axis, Bars, Figure, Panel
from sysid.report.answer import GOOD, POOR, USABLE, Answer
from sysid.report.page import Grid, Page, Picture, Section
from twin.compare.verdict import WORTH
from twin.mjcf.calibration import LACKING
from twin.mjcf.comparison import SUM, Cause, Departure, RobotComparison
from twin.mjcf.kinds import ODDS, VISIBLE
from twin.report.compare_words import share_text
from twin.report.mjcf import figure

_METHOD = (
    "Each kind of parameter is moved alone, at all drives, until the model fits the log best; the share is what "
    "vanishes of the departure beyond noise. The start of the log (first reading, speed, command before) is free "
    "throughout."
)


def page(result: RobotComparison, next_step: str) -> Page:
    """The report on one comparison; `next_step` is the sentence on what to do then."""
    names = ("model as it is", f"with {_words(_shown(result))}" if result.chain else "")
    pictures = []
    for k, run in enumerate(result.runs, 1):
        drawn = figure([run], names, run.drive)
        if not result.chain:  # nothing is moved: one model, not two over each other
            drawn = replace(drawn, panels=[replace(panel, items=panel.items[:-1]) for panel in drawn.panels])
        pictures.append(Picture.of(f"joint-{k}", drawn, _caption(result, run.drive)))
    causes = [] if result.nothing else [Picture.of("kinds", bars(result), _bars_caption(result))]
    tables_of_causes = [] if result.nothing else [kinds(result), *values(result)]
    worst = max(result.departures, key=lambda each: each.share)
    picture = pictures.pop([run.drive for run in result.runs].index(worst.drive))
    return Page(
        title=f"{result.runs[0].log} beside {result.robot.path.name}",
        subtitle=f"{', '.join(run.drive for run in result.runs)}, {len(result.runs[0].y)} samples, "
        f"Ts {result.runs[0].Ts:g} s",
        verdict=sentences(result),
        sections=[
            Section("Model and log", tables=[departures(result)], pictures=pictures),
            Section("Kinds of parameters", [_METHOD], tables=tables_of_causes, pictures=causes),
        ],
        made_with=versions(),
        answer=Answer(
            _size(worst.rms, worst.unit),
            f"RMS from the log to the model at {worst.drive}; noise of the log {_size(worst.noise, worst.unit)}",
            GOOD if result.nothing else USABLE if result.known else POOR,
            _sentence(result),
            picture,
            values=next(iter(values(result)), None) if not result.nothing else None,
            next=next_step,
        ),
    )


def _sentence(result: RobotComparison) -> str:
    """The verdict without its numbers."""
    if result.nothing:
        return "No departure that matters: no kind of parameter improves the fit by more than chance."
    if not result.known:
        return f"The robot does something that {result.robot.path.name} lacks: no kind of parameter explains it."
    causes = result.chain[-1]
    verb = "explains" if len(causes.kinds) == 1 else "explain"
    return f"{capital(_words(causes.kinds))} {verb} {share_text(causes.share)} of the departure."


def sentences(result: RobotComparison) -> list[str]:
    """The verdict in one sentence, then what stands behind it."""
    worst = max(result.departures, key=lambda each: each.share)
    texts = [_verdict(result, worst)]
    if len(result.departures) > 1 and not result.nothing:
        texts.append(f"{worst.drive} has {share_text(worst.share)} of the squared departure.")
    for k, cause in enumerate(result.chain if result.known else ()):
        texts += _alike(result, cause, k)
    if not result.known:
        texts.append(_nearest(result))
    return [*texts, *result.robot.notes, *result.remarks]


def _verdict(result: RobotComparison, worst: Departure) -> str:
    log, name, size = result.runs[0].log, result.robot.path.name, _size(worst.rms, worst.unit)
    if result.nothing:
        beyond = max(result.departures, key=lambda each: each.beyond / VISIBLE[each.unit])
        return (
            f"No departure that matters: {name} follows {log} within {size} RMS, of which noise makes "
            f"{_size(worst.noise, worst.unit)}; beyond noise {_size(beyond.beyond, beyond.unit)} is left, and no "
            f"kind of parameter improves it by more than chance and {_visible(beyond.unit)}."
        )
    if not result.known:
        return (
            f"The robot does something that {name} lacks: no kind of parameter explains the departure of {log} by "
            f"{size} RMS ({worst.drive}), so none is named."
        )
    causes = result.chain[-1]
    moved = "; ".join(_change(each.name, each.unit, each.before, each.value) for each in causes.changes)
    verb = "explains" if len(causes.kinds) == 1 else "explain"
    rivals = f", or {' or '.join(causes.alike)} in place of {causes.kinds[-1]}," if causes.alike else ""
    return (
        f"{capital(_words(causes.kinds))}{rivals} {verb} {share_text(causes.share)} of the departure of {size} RMS "
        f"({worst.drive}), and what is left is noise or below {_visible(worst.unit)}: {moved}."
    )


def _alike(result: RobotComparison, cause: Cause, k: int) -> list[str]:
    """The kinds that act like the k-th one of the chain."""
    if not cause.alike:
        return []
    verb = "acts" if len(cause.alike) == 1 else "act"
    beside = f" beside {_words(cause.kinds[:-1])}" if k else ""
    text = f"On this log {_words(cause.alike)} {verb} like {cause.kinds[-1]}{beside} (odds below {ODDS:g} to 1): "
    if {cause.kinds[-1], *cause.alike} <= SUM:
        return [f"{text}only the sum of damping and kv acts on a joint, so no log tells them apart."]
    return [f"{text}one is the cause. To tell them apart, record faster and larger motions, and compare that log too."]


def _nearest(result: RobotComparison) -> str:
    open_ones = [each for each in result.departures if not each.explained]
    worst = max(open_ones, key=lambda each: each.left / each.noise)
    times = f"{number(worst.left / worst.noise, 2)} times the noise" if worst.left > worst.noise else "no white noise"
    left = f"{_size(worst.left, worst.unit)} RMS beyond noise is left at {worst.drive}, {times}"
    if not result.chain:
        return f"No kind lowers the error by more than chance and {_visible(worst.unit)}; {left}."
    cause = result.chain[-1]
    verb = "comes" if len(cause.kinds) == 1 else "come"
    return f"{capital(_words(cause.kinds))} {verb} nearest ({share_text(cause.share)}), but {left}."


def _shown(result: RobotComparison) -> tuple[str, ...]:
    return result.chain[-1].kinds if result.chain else ()


def _words(kinds: Sequence[str]) -> str:
    return ", ".join(kinds[:-1]) + (" and " if len(kinds) > 1 else "") + kinds[-1]


def _size(value: float, unit: str) -> str:
    q = display_quantity("", unit)
    return f"{number(q.factor * value, 3)} {q.unit}"


def _visible(unit: str) -> str:
    q = display_quantity("", unit)
    return f"{q.factor * VISIBLE[unit]:g} {q.unit}"


def _number(value: float, unit: str) -> tuple[str, str]:
    """A value as a person reads it, and its unit: angles in degrees, gains per rad as in MJCF."""
    q = display_quantity("", unit if unit == "rad" else "1")
    return number(q.factor * value, 3), q.unit if unit == "rad" else unit


def _change(name: str, unit: str, before: float, value: float) -> str:
    (now, shown), (was, _) = _number(value, unit), _number(before, unit)
    return f"{name} {now} {shown} where the model has {was}"


def tables(result: RobotComparison) -> list[Grid]:
    """What the console shows."""
    return [departures(result), *([] if result.nothing else [kinds(result), *values(result)])]


def departures(result: RobotComparison) -> Grid:
    """What each actuator's log departs."""
    rows = [
        (
            each.drive,
            share_text(each.share),
            *(_size(value, each.unit) for value in (each.rms, each.noise, each.left)),
            "nothing that matters" if each.explained else "more than noise",
        )
        for each in result.departures
    ]
    head = ("actuator", "share of the departure", "RMS", "noise", "left beyond noise", "")
    return Grid(head, rows, last_text=True)


def kinds(result: RobotComparison) -> Grid:
    """Kinds that explain something, best first; the note names the others."""
    units = [run.unit for run in result.runs]
    telling = _telling(result)
    rows = [
        (cause.kinds[0], share_text(cause.share), ", ".join(map(_size, cause.left, units)), _state(result, cause))
        for cause in telling
    ]
    others = [cause.kinds[0] for cause in result.alone if cause not in telling]
    note = f"Moved alone, these explain less than {100 * WORTH:g} %: {', '.join(others)}." if others else ""
    head = ("kind, moved alone", "departure that vanishes", "RMS left", "")
    return Grid(head, rows, last_text=True, note=note)


def _telling(result: RobotComparison) -> list[Cause]:
    return [cause for cause in result.alone if cause.share >= WORTH or cause.kinds[0] in _shown(result)]


def _state(result: RobotComparison, cause: Cause) -> str:
    if cause.kinds[0] in _shown(result):
        return "named" if result.known else "nearest, not named"
    return f"like {result.chain[0].kinds[0]}" if result.chain and cause.kinds[0] in result.chain[0].alike else ""


def values(result: RobotComparison) -> list[Grid]:
    """The values of the last of the chain, in one table or none."""
    rows = []
    for each in result.chain[-1].changes if result.chain else ():
        (before, unit), (value, _) = _number(each.before, each.unit), _number(each.value, each.unit)
        rows.append((each.name, before, value, unit))
    head = ("moved", f"in {result.robot.path.name}", "log", "unit")
    note = "qpal calibrate gives their intervals."
    return [Grid(head, rows, last_text=True, note=note)] if rows else []


def bars(result: RobotComparison) -> Figure:
    """The share that each kind explains alone, best first."""
    causes = _telling(result) or list(result.alone[:1])
    shown = [cause.kinds[0] in _shown(result) for cause in causes]
    colours = [style.MODEL if each else style.SECOND for each in shown]
    bar = Bars([100 * cause.share for cause in causes], "share", colours, key=False)
    names = Axis(names=[cause.kinds[0] for cause in causes])
    panel = Panel([bar], names, Axis("departure that vanishes [%]", limits=(0.0, 102.0)), "moved alone")
    return Figure([panel], height=1.2 + 0.3 * len(causes))


def _caption(result: RobotComparison, drive: str) -> str:
    moved = f", and with {_words(_shown(result))} moved" if result.chain else ""
    return (
        f"{drive}: log, and the model as it is{moved}, in free run over each other; below, what is left. What is left "
        f"should be noise: neither coloured nor above {LACKING:g} times the noise of the readings."
    )


def _bars_caption(result: RobotComparison) -> str:
    dark = "named" if result.known else "nearest, and not named"
    best = result.alone[0]
    return (
        f"Share of the departure that vanishes when one kind alone is moved. Dark: {dark}. The best alone is "
        f"{best.kinds[0]}, {share_text(best.share)}."
    )

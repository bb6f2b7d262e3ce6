"""What a file holds and how it would be read: its columns, a mapping, the sampling, the repairs, and advice."""

import os
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import versions
from sysid.channels.column import soft_numbers
from sysid.channels.guess import NO_CLOCK, Given, guess
from sysid.channels.mapping import ROLES, ChannelMap, Range
from sysid.channels.mapping_file import map_text
from sysid.channels.reading import Mapping, complete, read_map_of, sample
from sysid.channels.roles import NONE_LEFT, TOGETHER
from sysid.channels.signals import Signals
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.diagnosis.advice import Advice, advise
from sysid.diagnosis.relation import without_effect
from sysid.diagnosis.signals import MAP_FILE, levels
from sysid.formats import TABLE, read_table
from sysid.structures import TABLE as STRUCTURES
from sysid.structures import HammersteinWiener, ProcessModel, ServoJoint
from sysid.workflow.evaluation import check_parts, moves_in_one_part
from sysid.workflow.plan import Plan
from sysid.workflow.record import check_moving
from sysid.workflow.room import has_room, smaller
from sysid.workflow.servo import is_of_servo

SECONDS = "SECONDS"  # stands for a sampling time that a person has to give
LONGEST = 20_000  # samples that the advice looks at


@dataclass(frozen=True)
class Column:
    """One column of the file: its unit as it is written, its role, its numbers, and cells that are none."""

    name: str
    unit: str
    role: str
    cells: int
    empty: int
    low: float
    high: float

    @property
    def kind(self) -> str:
        """What the numbers are in a word."""
        if self.empty == self.cells:
            return "text"
        return "constant" if self.low == self.high else "varies"


@dataclass(frozen=True)
class Inspection:
    """A file and its record. `signals` is None if the file is not read so; `problem` then says why.

    `obstacle` is why nothing can be identified from a record that is read, empty if something can.
    `why` are the reasons of the mapping, `unclear` what a person has to decide, `repairs` changes of the mapping that
    make a record of a file that is refused without them. `text` is the mapping as a file. `first` is the verb of `qpal`
    with the options that the first advice has.
    """

    path: Path
    format: str
    columns: tuple[Column, ...]
    reader_notes: tuple[str, ...]
    meta: dict[str, Any]
    mapping: ChannelMap
    given: bool
    text: str
    why: tuple[str, ...] = ()
    unclear: tuple[str, ...] = ()
    problem: str = ""
    repairs: tuple[str, ...] = ()
    signals: Signals | None = None
    advice: tuple[Advice, ...] = ()
    options: tuple[str, ...] = ()
    unwritten: tuple[str, ...] | None = None
    obstacle: str = ""
    first: tuple[str, ...] = ("identify",)

    @property
    def command(self) -> str:
        """The command that identifies this record, or writes the mapping that this needs; it has to be edited.

        Empty where no command helps: `problem` or `obstacle` then says what does.
        """
        together = next((text.partition(TOGETHER)[2] for text in self.unclear if TOGETHER in text), "")
        if self.lack:
            return ""
        if together and self.unwritten is not None and (clock := self._clock) is not None:
            first = shlex.join(["qpal", "identify", str(self.path)])
            return " ".join(filter(None, [first, together, shlex.join([*_without(self.unwritten, together), *clock])]))
        if self.unwritten is not None:
            return shlex.join(["qpal", "info", str(self.path), *self.unwritten, "--write-map", MAP_FILE])
        if self.obstacle or without_effect(self.advice) is not None or (self.problem and not self.repairs):
            return ""
        verb, *advised = self.first
        return shlex.join(["qpal", verb, str(self.path), *self.options, *advised])

    @property
    def assumption(self) -> str:
        """What the command takes for granted of the clock, empty for nothing."""
        match (self._clock if TOGETHER in " ".join(self.unclear) else None) or ():
            case ("--time", name, _, unit):
                return f"if {name!r} is in {unit}"
            case ("--ts", _):
                return f"with the sampling time in place of {SECONDS}"
        return ""

    @property
    def _clock(self) -> tuple[str, ...] | None:
        """The options for a clock that is unclear beside several inputs; None where more is unclear."""
        others = [text for text in self.unclear if TOGETHER not in text]
        if not others or self.unwritten is None:
            return ()
        if others == [NO_CLOCK]:
            return ("--ts", SECONDS)
        unit = re.search(r"--time-unit (\w+)", others[0])
        if len(others) > 1 or unit is None or not self.mapping.clock.column:
            return None
        return ("--time", self.mapping.clock.column, "--time-unit", unit[1])

    @property
    def lack(self) -> str:
        """What a log needs that has the signal which this one lacks; empty where a mapping can name all of them."""
        return next((t.partition(NONE_LEFT)[2].partition("; ")[2] for t in self.unclear if NONE_LEFT in t), "")

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal info FILE`, ready for JSON."""
        s = self.signals
        return {
            "file": str(self.path),
            "format": self.format,
            "columns": [vars(column) | {"kind": column.kind} for column in self.columns],
            "meta": self.meta,
            "mapping": self.mapping.model_dump(),
            "why": list(self.why),
            "unclear": list(self.unclear),
            "problem": self.problem or None,
            "suggested_repairs": list(self.repairs),
            "record": None if s is None else s.as_dict(),
            "sampling": None if s is None else sampling_facts(s),
            "advice": [vars(a) for a in self.advice],
            "next": self.command or None,
            "versions": versions(),
        }


def inspect_file(
    path: str | os.PathLike[str],
    mapping: Mapping | None = None,
    given: Given = Given(),  # noqa: B008 - it is frozen
    range: Range = Range(),  # noqa: B008
    map_path: str | None = None,
) -> Inspection:
    """What the file at `path` holds, and the record that `mapping`, or a guess, makes of it.

    A file that is refused is tried again with repairs, which the mapping of the result then has. `map_path` is where
    the mapping will be written, for the next command. Raises InputError for a file or mapping that cannot be read.
    """
    table = read_table(path)
    why: tuple[str, ...] = ()
    unclear: tuple[str, ...] = ()
    remarks: dict[str, str] = {}
    if mapping is not None:
        channel_map, why = complete(table, read_map_of(mapping))
    else:
        guessed_map = guess(table, given)
        channel_map, why, unclear, remarks = (
            guessed_map.mapping,
            guessed_map.why,
            guessed_map.unclear,
            dict(guessed_map.remarks),
        )
    if range != Range():
        channel_map = channel_map.within(range.start, range.stop)
    signals, problem = None, ""
    repairs: tuple[str, ...] = ()
    if not unclear:
        signals, problem = _try(table, channel_map, why)
    if problem and mapping is None:
        channel_map, signals, repairs = _repair(table, channel_map, why)
        remarks |= {f"repair.{entry}": "SUGGESTED for this file" for entry in repairs}
    title = f"How {Path(path).name} is read; edit it and give it with --map.\n" + "\n".join((*why, *unclear))
    file = map_path or (None if mapping is None or isinstance(mapping, ChannelMap) else str(mapping))
    options = _options(given, range, file, bool(repairs or unclear))
    findings = _advice(signals)
    return Inspection(
        table.path,
        TABLE[table.path.suffix.lower()].__name__,
        _columns(table, channel_map),
        table.notes,
        dict(table.meta),
        channel_map,
        mapping is not None,
        map_text(channel_map, title, remarks),
        why,
        unclear,
        problem,
        repairs,
        signals,
        tuple(a.of_file(str(table.path), options) for a in findings),
        options,
        _options(given, range, None, needs_map=False) if not file and (repairs or unclear) else None,
        _obstacle(signals),
        _first_command(signals, findings),
    )


def _first_command(signals: Signals | None, findings: Sequence[Advice]) -> tuple[str, ...]:
    """The command for this record without its file; a delay is an order of every model, and does not say which."""
    advised = [a.command for a in findings if a.command and a.severity != "fine" and a.topic != "delay"]
    first = next(iter(advised), ("identify",))
    if first[0] != "identify" or signals is None or (parts := _parts(signals)) is None:
        return first
    if is_of_servo(signals):
        first = "identify", "--structure", ServoJoint.name
    plan, data = parts
    if plan.whole and data.u.shape[1] == data.y.shape[1] == 1 and levels(data.u) == 2:  # a step test
        return "identify", "--structure", ProcessModel.name
    name = first[first.index("--structure") + 1] if "--structure" in first else HammersteinWiener.name
    if has_room(STRUCTURES[name](), data) or (recipe := smaller(data)) is None:
        return first
    return "identify", "--structure", recipe.name


def sampling_facts(signals: Signals) -> dict[str, Any]:
    """Ts, number and length of the record, and what the stamps were like; times in seconds."""
    clock = signals.sampling
    stamped = len(clock.steps) > 0
    return {
        "Ts": signals.Ts,
        "samples": signals.N,
        "duration": signals.N * signals.Ts,
        "median_step": clock.median if stamped else None,
        "smallest_step": float(clock.steps.min()) if stamped else None,
        "largest_step": float(clock.steps.max()) if stamped else None,
        "largest_distance_from_grid": clock.off if stamped else None,
        "first_stamp": clock.start if stamped else None,
        "interpolated": clock.interpolated,
        "repairs": dict(signals.counts),
    }


def _try(table: Table, mapping: ChannelMap, reasons: tuple[str, ...]) -> tuple[Signals | None, str]:
    try:
        return sample(table, mapping, reasons), ""
    except InputError as error:
        return None, str(error)


def _repair(
    table: Table, mapping: ChannelMap, reasons: tuple[str, ...]
) -> tuple[ChannelMap, Signals | None, tuple[str, ...]]:
    """The mapping with the fewest further repairs that make a record, and their entries; as it was if none do."""
    for changes in ({"empty": "fill"}, {"backward": "drop"}, {"empty": "fill", "backward": "drop"}):
        repair = mapping.repair.model_copy(update=changes)
        repaired_map = mapping.model_copy(update={"repair": repair})
        signals, _ = _try(table, repaired_map, reasons)
        if signals is not None:
            return repaired_map, signals, tuple(changes)
    return mapping, None, ()


def _obstacle(signals: Signals | None) -> str:
    """Why `qpal identify` refuses the record, by its own checks; empty if it does not."""
    if signals is None or not (signals.input and signals.output):
        return ""
    try:
        data = signals.io()
        check_moving(signals, data)
        check_parts(*_plan(data).parts(data))
    except InputError as error:
        return str(error)
    return ""


def _plan(data: IOData) -> Plan:
    """The plan of `qpal identify` where nothing else is asked: halves, or all where one of them has no movement."""
    halves = Plan()
    return replace(halves, whole=True) if moves_in_one_part(*halves.parts(data)) else halves


def _parts(signals: Signals) -> tuple[Plan, IOData] | None:
    """That plan and its estimation data; None of what is no record."""
    if not (signals.input and signals.output):
        return None
    try:
        data = signals.io()
        return (plan := _plan(data)), plan.parts(data)[0]
    except InputError:
        return None


def _columns(table: Table, mapping: ChannelMap) -> tuple[Column, ...]:
    roles = {mapping.clock.column: "clock", mapping.range.active: "active", mapping.range.drive: "drive"}
    for role in ROLES:
        for channel in getattr(mapping, role):
            roles |= {channel.times: f"times {role}", channel.direction: f"direction of {role}", channel.column: role}
    columns = []
    for name in table.names:
        values = soft_numbers(table, name)
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (float("nan"),) * 2
        role = roles.get(name, "")
        columns.append(Column(name, table.units.get(name, ""), role, len(values), len(values) - len(finite), low, high))
    return tuple(columns)


def _advice(signals: Signals | None) -> tuple[Advice, ...]:
    """Advice on a record with input and output; none where it cannot be given."""
    if signals is None or not (signals.input and signals.output):
        return ()
    try:
        data = signals.io()
        findings = advise(data.head(LONGEST))
        # Nobody is sent where he is.
        return tuple(replace(a, call="", command=()) if a.command == ("info",) else a for a in findings)
    except InputError as error:
        return (Advice("data", str(error), float("nan"), "", "warning"),)


def _without(options: Sequence[str], others: str) -> list[str]:
    """The pairs of an option and its value that are not among the `others`."""
    pairs = zip(options[::2], options[1::2], strict=True)
    return [word for name, value in pairs if name not in shlex.split(others) for word in (name, value)]


def _options(given: Given, range: Range, map_path: str | None, needs_map: bool) -> tuple[str, ...]:
    if map_path or needs_map:
        return ("--map", map_path or MAP_FILE)
    words = []
    for option, value in (
        ("--input", given.input),
        ("--output", given.output),
        ("--time", given.time),
        ("--time-unit", given.time_unit),
        ("--ts", None if given.Ts is None else f"{given.Ts:.9g}"),
    ):
        words += [option, value] if value is not None else []
    if range != Range():
        words += ["--range", ":".join("" if end is None else f"{end:g}" for end in (range.start, range.stop))]
    return tuple(words)

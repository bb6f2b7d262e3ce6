"""From a file and its named columns to a record ready for identification; `sysid.read`."""

import os
import re
from collections.abc import Mapping as _Mapping
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.quantities import of_place
from sysid.channels.guess import Given
from sysid.channels.mapping import Range
from sysid.channels.reading import Mapping, from_table, read_map_of, sample
from sysid.channels.signals import Signals
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.data.wraps import DEGREES, turn_of, unwrapped
from sysid.formats import read_table

OWN = {"input": "voltage_V", "output": "angle_rad", "time": "time_s"}  # the columns that a log of ours has
_ARGUMENTS = {"ts": "Ts", "time-unit": "time_unit"}  # of the command line, whose arguments have other names here


@dataclass(frozen=True)
class Record:
    """The data and their source columns.

    `signals` says how the file was read, `remarks` in sentences what was done after that. `options` are those of the
    command line that read it so again; none for what is detected. A record of several files has the signals of the
    first, all names in `files`, and one experiment for each of them; `beside` are files that hold its other signals.
    Several columns are one text, "a,b".
    `header` is what the file says of itself besides its columns.
    """

    path: Path
    data: IOData
    input: str
    output: str
    time: str | None
    signals: Signals
    options: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    header: _Mapping[str, Any] = field(default_factory=dict)
    beside: tuple[Path, ...] = ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file of the record, in the order in which the command line takes them."""
        return (*(self.files or (self.path,)), *self.beside)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed and repaired."""
        return (*self.signals.notes, *self.remarks)

    def as_dict(self) -> dict:
        """File, columns, units, Ts [s], number of samples, notes and counts of repairs, for a summary.

        Several files and channels have lists of their own.
        """
        lists: dict = {}
        if len(self.files) > 1:
            lengths = zip(self.files, self.data.lengths, strict=True)
            lists["experiments"] = [{"file": str(path), "samples": n} for path, n in lengths]
        if self.beside:
            lists["files"] = [str(path) for path in self.paths]
        if self.data.u.shape[1] > 1 or self.data.y.shape[1] > 1:
            roles = (("input", self.signals.input), ("output", self.signals.output))
            lists["channels"] = [
                {"role": role, "column": s.column, "name": s.name, "unit": s.unit}
                for role, role_signals in roles
                for s in role_signals
            ]
        return {
            "file": str(self.path),
            "input": self.input,
            "output": self.output,
            "time": self.time,
            "units": {"input": self.data.u_unit, "output": self.data.y_unit},
            "Ts": self.data.Ts,
            "samples": self.data.N,
            "notes": list(self.notes),
            "repairs": dict(self.signals.counts),
            "mapping": self.signals.as_dict()["mapping"],
            **lists,
        }


def read_record(
    path: str | os.PathLike[str] | Table,
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    mapping: Mapping | None = None,
    range: Range = Range(),  # noqa: B008 - it is frozen
    time_unit: str | None = None,
    missing: str = "refuse",
    moving: bool = True,
) -> Record:
    """The record in the file at `path`, or in its table, from the named columns; "a,b" names two of them.

    Columns that are not named are found by name, unit and numbers where that is beyond doubt; a file of two columns is
    read as input, output. `mapping`, a ChannelMap or its file, says instead how the file is read. Ts [s] comes from
    `Ts` or from the clock. Empty cells of outputs are an error if `missing` is "refuse", else missing samples; a
    mapping says itself what they are. `notes` lists assumptions and repairs. Raises InputError with file and place for
    missing or unclear columns, columns of different lengths, cells that are not finite numbers, a constant signal
    unless `moving` is False, and time stamps that cannot be made uniform (`sysid.channels`).
    """
    check_given(Given(input, output, time, time_unit, Ts), mapping)
    table = path if isinstance(path, Table) else read_table(path)
    u, y = (columns(text, table.names) for text in (input, output))
    further_columns = {"input": u[1:], "output": y[1:]} if len(u) > 1 or len(y) > 1 else None
    given = Given(u[0] if u else None, y[0] if y else None, time, time_unit, Ts, further_columns)
    if mapping is not None:
        channel_map = read_map_of(mapping)
        if range != Range():
            channel_map = channel_map.within(range.start, range.stop)
        signals = sample(table, channel_map)
    else:
        signals = from_table(table, given, range, "refuse" if missing == "refuse" else "outputs")
    path, header = table.path, dict(table.meta)
    del table  # its clock is not needed any more, and a long record has no room for it
    data = signals.io()
    if moving:
        check_moving(signals, data)
    inputs, outputs = (
        ",".join(signal.column for signal in role_signals) for role_signals in (signals.input, signals.output)
    )
    options = _options(given, mapping, range, signals)
    clock = signals.mapping.clock.column or None
    return Record(path, data, inputs, outputs, clock, signals, options, _channel_numbers(signals), header=header)


def columns(text: str | None, names: Sequence[str]) -> tuple[str, ...]:
    """The columns that "a,b" names, none for None; a text that is a column's name as a whole is that one."""
    if text is None:
        return ()
    names_found = (text,) if text in names else tuple(part.strip() for part in text.split(",") if part.strip())
    if len(set(names_found)) < len(names_found) or not names_found:
        raise InputError(f"the columns {text!r} name one twice, or none; give each once")
    return names_found


def check_given(given: Given, mapping: Mapping | None) -> None:
    """Raises InputError for options that exclude each other, and for a sampling time that is none."""
    if given.Ts is not None and not (np.isfinite(given.Ts) and given.Ts > 0):
        raise InputError(f"--ts is {given.Ts:g}; give the sampling time as a positive number of seconds")
    if given.time_unit is not None and given.time is None:
        raise InputError(f"--time-unit is {given.time_unit!r} without --time; name the time column with --time")
    if mapping is None:
        return
    for option, value in vars(given).items():
        if value is not None:
            raise InputError(
                f"--{option.replace('_', '-').lower()} and --map are given; the mapping names columns, clock and "
                "sampling time: leave one of the two out"
            )


def _channel_numbers(signals: Signals) -> tuple[str, ...]:
    """A sentence for the names u1, u2 by which others call several channels."""
    sentences = (
        f"{', '.join(f'{letter}{k}' for k in range(1, len(role_signals) + 1))} are the columns "
        + ", ".join(repr(signal.column) for signal in role_signals)
        for letter, role_signals in (("u", signals.input), ("y", signals.output))
        if len(role_signals) > 1
    )
    return tuple(sentences)


def _options(given: Given, mapping: Mapping | None, range: Range, signals: Signals) -> tuple[str, ...]:
    words: list[str] = []
    further_columns = given.more or {}
    if mapping is not None:
        words += ["--map", "MAP.toml" if hasattr(mapping, "clock") else str(mapping)]
    for option, value in (
        ("--input", given.input and ",".join([given.input, *further_columns.get("input", ())])),
        ("--output", given.output and ",".join([given.output, *further_columns.get("output", ())])),
        ("--time", given.time),
        ("--time-unit", given.time_unit),
        ("--ts", None if given.Ts is None or given.time is not None else f"{signals.Ts:.9g}"),
    ):
        words += [option, value] if value is not None else []
    if range != Range():
        ends = ("" if end is None else f"{end:g}" for end in (range.start, range.stop))
        words += ["--range", ":".join(ends)]
    return tuple(words)


def check_moving(signals: Signals, data: IOData) -> None:
    """Raises InputError for a channel that has one value in all samples of its record `data`."""
    for role, names, values in (("input", signals.input, data.u), ("output", signals.output, data.y)):
        for k, signal in enumerate(names):
            _check_moves(signals, role, signal.column, values[:, k])


def _check_moves(signals: Signals, role: str, name: str, values: np.ndarray) -> None:
    if np.ptp(values) == 0:
        raise InputError(
            f"{signals.path}: the {role} {name!r} is {values[0]:g} in all {len(values)} samples; "
            f"choose a column that moves"
        )


@checked
def read(
    path: str | os.PathLike[str],
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    map: Mapping | None = None,
    start: float | None = None,
    stop: float | None = None,
    time_unit: str | None = None,
    missing: str = "mark",
) -> IOData:
    """The record in a file: CSV, Parquet, MAT, NumPy, JSON, a serial capture, and with their extra MCAP and ROS bags.

    `input` and `output` name columns; what is not named is found by name, unit and numbers where that is beyond doubt.
    Ts [s] comes from `Ts` or from the column `time`, in `time_unit`. `map`, a `ChannelMap` or the path of one, says
    instead how the file is read, with several channels, scales and repairs. `start` and `stop` [s] after the first
    stamp cut the record. `missing` says what becomes of outputs without a value, such as empty cells: "mark" (missing
    samples), "fill" or "refuse". Names stay, units become SI (degrees become rad). What was assumed and repaired:
    `sysid.workflow.record.read_record(path).notes`. Raises InputError that names the file and the place.
    """
    cut = Range(start=start, stop=stop)
    try:
        return read_record(path, input, output, Ts, time, map, cut, time_unit, missing).data
    except InputError as error:
        raise InputError(words_for_python(str(error))) from None


def words_for_python(sentence: str) -> str:
    """The sentence with arguments of `read` in place of options of the command line."""
    sentence = re.sub(r"--range(?= \d| or|$)", "start= and stop=", sentence)
    sentence = sentence.replace("--ts SECONDS", "Ts=SECONDS")
    return re.sub(r"--(input|output|ts|time-unit|time|map)\b( is)?", _argument, sentence)


def _argument(match: re.Match) -> str:
    """Ts= for --ts, and Ts where the sentence says what it is."""
    name = _ARGUMENTS.get(match[1], match[1])
    return f"{name} is" if match[2] else f"{name}="


def without_wraps(record: Record) -> Record:
    """The record with its output's wraps at a turn undone, and those of a goal in the same unit; one note says so.

    The turn is that of the output's unit; an output without a unit may show any of `sysid.data.wraps.TURNS`. A goal
    goes the shorter way at each of its jumps and begins within half a turn of the angle.
    """
    data = record.data
    wraps = unwrapped(data, turn_of(data) if data.y_unit in ("rad", *DEGREES) else None)
    if not wraps.count:
        return record
    out, note = wraps.data, f"column {record.output!r}: {wraps.sentence}"
    if data.u_unit == data.y_unit and data.u_unit in ("rad", *DEGREES):
        out = replace(out, u=_follow_goal(data, wraps.turn))
    return replace(record, data=out, remarks=(*record.remarks, note))


def with_places(record: Record) -> Record:
    """The record with the place, 0 at its first sample, instead of a speed: a joint between stops is one of places.

    The place is the sum of the speed by trapezoids; missing speeds are on straight lines. One note says so.
    """
    data = record.data
    unit = of_place(data.y_unit or "")
    if not unit or unit == data.y_unit:
        return record
    parts = [
        replace(part, y=cumulative_trapezoid(part.y, dx=part.Ts, axis=0, initial=0.0), y_unit=unit, missing=None)
        for part in data.experiments
    ]
    note = (
        f"column {record.output!r} is a speed: the joint is fitted to the place that it leads to, 0 at the start; an "
        "offset of the sensor becomes a drift, unless a mapping takes it away (offset of [[output]])"
    )
    outputs = tuple(replace(signal, unit=unit) for signal in record.signals.output)
    signals = replace(record.signals, output=outputs)
    return replace(record, data=IOData.merge(*parts), signals=signals, remarks=(*record.remarks, note))


def _follow_goal(data: IOData, turn: float) -> np.ndarray:
    """The goal (N, nu) beside an angle that counts on over turns."""
    goal = data.u if np.ptp(data.u) > turn else np.unwrap(data.u, period=turn, axis=0)
    return goal + turn * np.round((data.y[0, 0] - goal[0]) / turn)

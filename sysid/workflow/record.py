"""From a file and its named columns to a record ready for identification."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.guess import Given
from sysid.channels.mapping import Range
from sysid.channels.reading import Mapping, from_table, read_map_of
from sysid.channels.sampling import sample
from sysid.channels.signals import Signals
from sysid.data.record import IOData
from sysid.formats import read_table

OWN = {"input": "voltage_V", "output": "angle_rad", "time": "time_s"}  # the columns that a log of ours has


@dataclass(frozen=True)
class Record:
    """The data and their source columns.

    `signals` says how the file was read, `remarks` in sentences what was done after that. `options` are those of the
    command line that read it so again; none for what is detected.
    """

    path: Path
    data: IOData
    input: str
    output: str
    time: str | None
    signals: Signals
    options: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed and repaired."""
        return (*self.signals.notes, *self.remarks)

    def as_dict(self) -> dict:
        """File, columns, units, Ts [s], number of samples, notes and counts of repairs, for a summary."""
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
        }


def read_record(
    path: str | os.PathLike[str],
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    mapping: Mapping | None = None,
    range: Range = Range(),  # noqa: B008 - it is frozen
    time_unit: str | None = None,
) -> Record:
    """The record in the file at `path`, from the named columns.

    Columns that are not named are found by name, unit and numbers where that is beyond doubt; a file of two columns is
    read as input, output. `mapping`, a ChannelMap or its file, says instead how the file is read. Ts [s] comes from
    `Ts` or from the clock. `notes` lists assumptions and repairs. Raises InputError with file and place for missing or
    unclear columns, columns of different lengths, cells that are not finite numbers, a constant signal, and time
    stamps that cannot be made uniform (`sysid.channels`).
    """
    given = Given(input, output, time, time_unit, Ts)
    check_given(given, mapping)
    table = read_table(path)
    if mapping is not None:
        chosen = read_map_of(mapping)
        if range != Range():
            chosen = chosen.model_copy(update={"range": range.model_copy(update={"active": chosen.range.active})})
        signals = sample(table, chosen)
    else:
        signals = from_table(table, given, range)
    data = signals.io()
    for role, names, values in (("input", signals.input, data.u), ("output", signals.output, data.y)):
        for k, signal in enumerate(names):
            _check_moves(signals, role, signal.column, values[:, k])
    (u, *_), (y, *_) = signals.input, signals.output
    options = _options(given, mapping, range, signals)
    return Record(table.path, data, u.column, y.column, signals.mapping.clock.column or None, signals, options)


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


def _options(given: Given, mapping: Mapping | None, range: Range, signals: Signals) -> tuple[str, ...]:
    words: list[str] = []
    if mapping is not None:
        words += ["--map", "MAP.toml" if hasattr(mapping, "clock") else str(mapping)]
    for option, value in (
        ("--input", given.input),
        ("--output", given.output),
        ("--time", given.time),
        ("--time-unit", given.time_unit),
        ("--ts", None if given.Ts is None or given.time is not None else f"{signals.Ts:.9g}"),
    ):
        words += [option, value] if value is not None else []
    if range != Range():
        ends = ("" if end is None else f"{end:g}" for end in (range.start, range.stop))
        words += ["--range", ":".join(ends)]
    return tuple(words)


def _check_moves(signals: Signals, role: str, name: str, values: np.ndarray) -> None:
    if np.ptp(values) == 0:
        raise InputError(
            f"{signals.path}: the {role} {name!r} is {values[0]:g} in all {len(values)} samples; "
            f"choose a column that moves"
        )

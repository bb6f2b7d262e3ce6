"""Files that hold one signal each of one record, as oscilloscopes export channels: together they are one table."""

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.channels.clock import is_named_clock
from sysid.channels.column import column_of
from sysid.data.table import Table
from sysid.formats import read_table

COLUMNS = 2  # of such a file: a time and a signal
OVERLAP = 0.5  # of the longest file, in which all show one time: files of other times are no record
SAME = 1e-3  # of a step, by which stamps that are rounded to some digits differ


def one_table(paths: Sequence[str | os.PathLike[str]]) -> Table | None:
    """The table of files that hold one signal each of one record; None of others, and of a single file."""
    if len(paths) < 2 or len((first := read_table(paths[0])).names) > COLUMNS:
        return None
    return as_one([first, *(read_table(path) for path in paths[1:])])


def as_one(tables: Sequence[Table]) -> Table | None:
    """One table of the signals of several, each of which has a clock and one signal.

    With the same stamps they have one clock, and a name that several files have gets the file's; with others each
    signal has its own. None for others: files of the same signals are experiments.
    """
    pairs = [_clock_and_signal(table) for table in tables]
    clocks = [pair[0] for pair in pairs if pair is not None]
    if len(tables) < 2 or len(clocks) < len(tables):
        return None
    first, signals = tables[0], [pair[1] for pair in pairs if pair is not None]
    stamps = [table.numbers(clock) for table, clock in zip(tables, clocks, strict=True)]
    step = float(np.median(np.diff(stamps[0])))
    if any(len(t) != len(stamps[0]) or np.abs(t - stamps[0]).max() > SAME * step for t in stamps[1:]):
        return _of_own_clocks(tables, clocks, signals, stamps)
    names = [name if signals.count(name) == 1 else table.path.stem for table, name in zip(tables, signals, strict=True)]
    if len({*names, clocks[0]}) <= len(tables):
        return None
    columns = [table.columns[table.names.index(name)] for table, name in zip(tables, signals, strict=True)]
    units = {own: table.units.get(name, "") for table, name, own in zip(tables, signals, names, strict=True)}
    units[clocks[0]] = first.units.get(clocks[0], "")
    j = first.names.index(clocks[0])
    origin = " and ".join(f"{name!r} of {table.path.name}" for table, name in zip(tables, names, strict=True))
    return replace(
        first,
        names=(clocks[0], *names),
        columns=(first.columns[j], *columns),
        rows=(first.rows[j],) * (len(names) + 1),
        units={name: unit for name, unit in units.items() if unit},
        notes=(*dict.fromkeys(n for t in tables for n in t.notes), f"the files are one record with one time: {origin}"),
    )


def _of_own_clocks(
    tables: Sequence[Table], clocks: Sequence[str], signals: Sequence[str], stamps: Sequence[np.ndarray]
) -> Table | None:
    """One table of signals of other names, each with the clock of its file; None where these do not overlap."""
    begin, end = max(t[0] for t in stamps), min(t[-1] for t in stamps)
    if len({*signals}) < len(signals) or end - begin < OVERLAP * max(t[-1] - t[0] for t in stamps):
        return None
    own = [f"{clock} of {signal}" for clock, signal in zip(clocks, signals, strict=True)]
    parts = [
        (table, table.names.index(name)) for table, *pair in zip(tables, clocks, signals, strict=True) for name in pair
    ]
    names = [name for pair in zip(own, signals, strict=True) for name in pair]
    units = {
        name: table.units[table.names[j]]
        for name, (table, j) in zip(names, parts, strict=True)
        if table.names[j] in table.units
    }
    origin = " and ".join(f"{name!r} of {table.path.name}" for table, name in zip(tables, signals, strict=True))
    return replace(
        tables[0],
        names=tuple(names),
        columns=tuple(table.columns[j] for table, j in parts),
        rows=tuple(table.rows[j] for table, j in parts),
        units=units,
        clocks=dict(zip(signals, own, strict=True)),
        notes=(
            *dict.fromkeys(n for t in tables for n in t.notes),
            f"the files are one record, each with its time: {origin}",
        ),
    )


def _clock_and_signal(table: Table) -> tuple[str, str] | None:
    """The clock and the only signal of a table that has no more."""
    columns = [column_of(table, name) for name in table.names]
    clocks = [c.name for c in columns if (is_named_clock(c.header) or c.dated) and c.rising]
    signals = [c.name for c in columns if c.numeric and c.name not in clocks]
    return (clocks[0], signals[0]) if len(clocks) == len(signals) == 1 else None

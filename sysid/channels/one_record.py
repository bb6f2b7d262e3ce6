"""Files that hold one signal each of one record, as oscilloscopes export channels: together they are one table."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.channels.clock import is_named_clock
from sysid.channels.column import column_of
from sysid.data.table import Table

COLUMNS = 2  # of such a file: a time and a signal
OVERLAP = 0.5  # of the longest file, in which all show one time: files of other times are no record
SAME = 1e-3  # of a step, by which stamps that are rounded to some digits differ


def as_one(tables: Sequence[Table]) -> Table | None:
    """One table of the signals of several, each of which has a clock and one signal.

    With the same stamps they have one clock, and a name that several files have gets the file's; with others each
    signal has its own. None for others: files of the same signals are experiments.
    """
    pairs = [pair for table in tables if (pair := _clock_and_signal(table)) is not None]
    if len(tables) < 2 or len(pairs) < len(tables):
        return None
    clocks, signals = zip(*pairs, strict=True)
    stamps = [table.numbers(clock) for table, clock in zip(tables, clocks, strict=True)]
    step = float(np.median(np.diff(stamps[0])))
    if all(len(t) == len(stamps[0]) and np.abs(t - stamps[0]).max() <= SAME * step for t in stamps[1:]):
        pairs_of_names = zip(tables, signals, strict=True)
        names = [name if signals.count(name) == 1 else table.path.stem for table, name in pairs_of_names]
        own = [clocks[0]] + [""] * (len(tables) - 1)
    elif _overlap(stamps):
        names, own = list(signals), [f"{clock} of {signal}" for clock, signal in pairs]
    else:
        return None
    shown = [name for name in own if name]
    return None if len({*names, *shown}) < len(names) + len(shown) else _joined(tables, pairs, names, own)


def _overlap(stamps: Sequence[np.ndarray]) -> bool:
    begin, end = max(t[0] for t in stamps), min(t[-1] for t in stamps)
    return bool(end - begin >= OVERLAP * max(t[-1] - t[0] for t in stamps))


def _joined(
    tables: Sequence[Table], pairs: Sequence[tuple[str, str]], names: Sequence[str], clocks: Sequence[str]
) -> Table:
    """One table of the `pairs` of clock and signal under new names; a clock without a name is left out."""
    parts = [
        (own, table, table.names.index(name))
        for table, pair, new in zip(tables, pairs, zip(clocks, names, strict=True), strict=True)
        for name, own in zip(pair, new, strict=True)
        if own
    ]
    time = ", each with its time" if all(clocks) else " with one time"
    origin = " and ".join(f"{name!r} of {table.path.name}" for table, name in zip(tables, names, strict=True))
    return replace(
        tables[0],
        names=tuple(own for own, _, _ in parts),
        columns=tuple(table.columns[j] for _, table, j in parts),
        rows=tuple(table.rows[j] for _, table, j in parts),
        units={own: table.units[table.names[j]] for own, table, j in parts if table.units.get(table.names[j])},
        clocks=dict(zip(names, clocks, strict=True)) if all(clocks) else {},
        notes=(*dict.fromkeys(n for t in tables for n in t.notes), f"the files are one record{time}: {origin}"),
    )


def _clock_and_signal(table: Table) -> tuple[str, str] | None:
    """The clock and the only signal of a table that has no more."""
    columns = [column_of(table, name) for name in table.names]
    clocks = [c.name for c in columns if (is_named_clock(c.header) or c.dated) and c.rising]
    signals = [c.name for c in columns if c.numeric and c.name not in clocks]
    return (clocks[0], signals[0]) if len(clocks) == len(signals) == 1 else None

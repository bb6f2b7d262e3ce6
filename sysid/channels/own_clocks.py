"""Clocks of their own: which column of stamps belongs to which signal, in a table whose reader does not know it.

One rule for every format. A signal has the clock whose name shares the signal's (`t_u`, `u`; `input.t`, `input.v`), or
its role (`t_in`, `u`), else the only one of its length, else the one before it where clock and signals follow each
other throughout (`X, Y, X2, Y2`), or behind it where the signals come first. Only clocks that overlap are compared;
`clock` of a channel in a mapping says it instead.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.clock import CLOCK_WORDS, SAME_TIME, is_named_clock, unit_of_clock
from sysid.channels.clock_choice import is_measurement
from sysid.channels.column import Column, column_of, parse_header, words
from sysid.channels.complaints import brief
from sysid.channels.conversion import TIMES, convert, is_time
from sysid.channels.mapping import ChannelMap
from sysid.channels.roles import INPUT, OUTPUT, REFERENCE, WEAK_INPUT, WEAK_OUTPUT, Columns
from sysid.data.table import Table

SPAN = 0.1  # of the longer of two spans, by which columns without a name may begin and end apart and be clocks still
BEFORE, BEHIND = "it stands before it", "it stands behind it"
SHOWN = 6  # signals in a sentence
STEM_NOT = CLOCK_WORDS | set(TIMES) | words("header stamps times x axis")
ROLE_WORDS = {"input": INPUT | REFERENCE | WEAK_INPUT, "output": OUTPUT | WEAK_OUTPUT}
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_]+")


def with_own_clocks(table: Table) -> tuple[Table, str]:
    """The table with `clocks` where its signals have several, and the reasons; others as they are, and nothing."""
    names = _likely_clocks(table)
    if table.clocks or len(names) < 2:
        return table, ""
    columns = {name: column for name in table.names if (column := column_of(table, name)).numeric}
    clocks = {name: columns[name] for name in names if name in columns and _is_clock(columns[name])}
    nameless = not any(map(_says_time, clocks.values()))
    if nameless:
        clocks = _alike(clocks)
    signals = {name: c for name, c in columns.items() if name not in clocks and not _says_time(c)}
    lengths = {name: table.length(name) for name in columns}
    found = {name: pair for name in signals if (pair := _clock_of(name, clocks, signals, lengths)) is not None}
    used = {name: clocks[name] for name, _ in found.values()}
    if len(used) < 2 or not _belong_to_signals(used, {reason for _, reason in found.values()}, nameless):
        return table, ""
    how = ", ".join(f"{clock!r} is the clock of {name!r} ({why})" for name, (clock, why) in list(found.items())[:SHOWN])
    how += f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    note = f"signals have clocks of their own: {how}; if not so, set clock of [[input]] and [[output]] in a mapping"
    return replace(table, clocks={name: clock for name, (clock, _) in found.items()}), note


def with_clocks(table: Table, mapping: ChannelMap) -> tuple[Table, ChannelMap, tuple[str, ...]]:
    """The table with the clocks that the channels of a mapping name, else by the rule where [clock] is the output's;
    the mapping with the clock of its output, and notes.

    Raises InputError for a clock of another length than its channel, and for an output with another than [clock] says.
    """
    channels = mapping.channels()
    named = {channel.column: (channel.clock, entry) for _, channel, entry in channels if channel.clock}
    if not named:
        ruled, note = with_own_clocks(table)
        its = {ruled.clocks.get(channel.column) for channel in mapping.output}
        return (ruled, mapping, (note,)) if note and its == {mapping.clock.column} else (table, mapping, ())
    for column, (clock, entry) in named.items():
        if table.length(clock) != table.length(column):
            fitting = [c for c in _likely_clocks(table) if table.length(c) == table.length(column) and c != column]
            raise InputError(
                f"{table.path}: clock of [[{entry}]] is {brief(clock)!r}, which has {table.length(clock)} samples, and "
                f"column {brief(column)!r} has {table.length(column)}; name the stamps of that column"
                f"{', such as ' + repr(fitting[0]) if fitting else ''}"
            )
    own = mapping.clock.column
    first = next((named[c.column] for c in mapping.output if c.column in named), ("", ""))
    if not own and first[0]:
        own = first[0]
        mapping = mapping.model_copy(update={"clock": mapping.clock.model_copy(update={"column": own})})
    elif first[0] and first[0] != own:
        raise InputError(
            f"{table.path}: clock of [[{first[1]}]] is {brief(first[0])!r} and column of [clock] is {brief(own)!r}, "
            "and the rows are those of the output; leave one of the two out"
        )
    clocks = {channel.column: named.get(channel.column, (own, ""))[0] for _, channel, _ in channels}
    return replace(table, clocks=clocks if len(set(clocks.values())) > 1 else {}), mapping, ()


def _likely_clocks(table: Table) -> list[str]:
    """Columns that may be clocks by their headers: those that say time, else x, numbers, and the first of matrices."""
    headers = {name: parse_header(name, table.units.get(name, "")) for name in table.names}
    named = [n for n, h in headers.items() if is_named_clock(h) or is_time(h.unit) or n in table.dates]
    if len(named) > 1:
        return named
    return [n for n, h in headers.items() if h.words in ({"x"}, {"x", "axis"}) or n.isdigit() or n.endswith(":1")]


def _is_clock(column: Column) -> bool:
    if _says_time(column):
        return column.rising and not column.constant and not is_measurement(column)
    return len(column.finite) > 2 and bool(np.all(np.diff(column.finite) > 0))


def _says_time(column: Column) -> bool:
    return is_named_clock(column.header) or is_time(column.header.unit) or column.dated


def _alike(clocks: Columns) -> dict[str, Column]:
    """Those of columns without telling names that go over the span of the first: a ramp hardly does."""
    spans = {name: (c.finite[0], c.finite[-1]) for name, c in clocks.items()}
    low, high = next(iter(spans.values()), (0.0, 0.0))
    limit = SPAN * (high - low)
    return {n: c for n, c in clocks.items() if abs(spans[n][0] - low) <= limit and abs(spans[n][1] - high) <= limit}


def _stem(column: Column) -> frozenset[str]:
    """The words and numbers of a name without those that say time."""
    return frozenset(word.lower() for word in _TOKEN.findall(column.header.base)) - STEM_NOT


def _clock_of(name: str, clocks: Columns, signals: Columns, lengths: Mapping[str, int]) -> tuple[str, str] | None:
    """The clock of a signal and the reason; None where the rule finds none."""
    fitting = {clock: column for clock, column in clocks.items() if lengths[clock] == lengths[name]}
    tokens = frozenset(word.lower() for word in _TOKEN.findall(signals[name].header.base))
    shared = {clock: len(stem) for clock, c in fitting.items() if (stem := _stem(c)) and stem <= tokens}
    if best := [clock for clock, count in shared.items() if count == max(shared.values())]:
        return (best[0], "its name says so") if len(best) == 1 else None
    for each in ROLE_WORDS.values():
        mine = [clock for clock, column in fitting.items() if _stem(column) & each]
        if len(mine) == 1 and signals[name].header.has(each):
            return mine[0], "both names say so"
    sizes = {clock: _size(column) for clock, column in fitting.items()}
    mine = [clock for clock, size in sizes.items() if size == _size(signals[name])]
    if len(mine) == 1 and (len(fitting) < len(clocks) or len(set(sizes.values())) == len(sizes)):
        return mine[0], "both have one length"
    order, reason = [each for each in lengths if each in clocks or each in signals], BEFORE
    if order[0] in signals:
        order, reason = order[::-1], BEHIND
    if order[0] in signals or order[-1] in clocks or any(a in clocks and b in clocks for a, b in pairwise(order)):
        return None
    nearest = [each for each in order[: order.index(name)] if each in clocks][-1]
    return (nearest, reason) if nearest in fitting else None


def _size(column: Column) -> int:
    """The number of cells up to the last that has a value: shorter columns of a table of text end in empty cells."""
    places = np.flatnonzero(np.isfinite(column.values))
    return int(places[-1]) + 1 if len(places) else 0


def _belong_to_signals(clocks: Columns, reasons: set[str], nameless: bool) -> bool:
    """Whether the clocks overlap, and are not one time of the rows, shown twice.

    A shift that is the same in all rows may also be that between two clocks of a whole row, the board's and the
    host's: then the names have to say that each belongs to a signal, or to be one but for a number.
    """
    factors = [convert(unit_of_clock(column).unit or "s").factor for column in clocks.values()]
    times = [column.values * factor for column, factor in zip(clocks.values(), factors, strict=True)]
    if max(np.nanmin(t) for t in times) >= min(np.nanmax(t) for t in times):
        return False
    if nameless or any(len(t) != len(times[0]) for t in times):
        return True
    step = min(column.step * factor for column, factor in zip(clocks.values(), factors, strict=True))
    first = times[0]
    if any(not np.array_equal(np.isfinite(t), np.isfinite(first)) for t in times):
        return True
    distances = [(t - first)[np.isfinite(first)] for t in times[1:]]
    if any(np.ptp(each) > SAME_TIME * step for each in distances):
        return True
    if all(abs(float(np.median(each))) <= SAME_TIME * step for each in distances):
        return False
    letters = {frozenset(c.header.words) for c in clocks.values()}
    return reasons.isdisjoint((BEFORE, BEHIND)) or len(letters) == 1

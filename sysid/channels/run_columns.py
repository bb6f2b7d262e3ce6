"""Columns that number or name experiments or rigs, whose rows may stand among each other."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from sysid.channels.clock import is_named_clock
from sysid.channels.column import RISING, Column, column_of, parse_header, soft_numbers, words
from sysid.channels.complaints import brief
from sysid.channels.repair import take_rows
from sysid.channels.restarts import SHORTEST
from sysid.channels.roles import role_by_name
from sysid.data.table import Table
from sysid.formats import EXPERIMENT_WORDS, RUN_WORDS

_NUMBER = words("index idx id nr no num number count")
_FILE = words("file filename")  # the files that a table was put together from
_RIG = words("id motor servo joint axis actuator board unit device node address addr channel")  # that take turns
_WORDS = EXPERIMENT_WORDS | RUN_WORDS | _FILE
NEAR = 0.5  # of the usual step: clocks that are not within it are not even
UNEVEN = 0.6  # of the steps at most are near the usual one where two clocks or more stand among each other


def column_of_experiments(columns: Mapping[str, Column]) -> Column | None:
    """The column that numbers experiments, by its name and numbers that stay for many rows and never return."""
    for column in columns.values():
        header = column.header.words
        if not _may_number(header) or not _in_stretches(column):
            continue
        if header & EXPERIMENT_WORDS or set(np.unique(column.values).tolist()) != {0.0, 1.0}:  # which is a switch
            return column
    return None


def note_on_stretches(table: Table, columns: Mapping[str, Column], used: Collection[str | None]) -> list[str]:
    """What is said of the first column that stays for long stretches, as one that tells experiments apart does, but
    whose name does not say so; `columns` are those of numbers, and those that are `used` are none. Words may come
    again, as RUN and IDLE do.
    """
    texts = {name: column for name in table.names if (column := labels(table, name)) is not None}
    for name, column in {**columns, **texts}.items():
        if name not in used and role_by_name(column) in ("", "none") and _in_stretches(column, name in texts):
            count = 1 + np.count_nonzero(np.diff(column.values))
            return [
                f"column {name!r} stays in each of {count} stretches of rows and is not used: if it tells experiments "
                f'apart, set experiment = "{brief(name)}" under [range] in a mapping, and part for one of them alone'
            ]
    return []


def _in_stretches(column: Column, again: bool = False) -> bool:
    """Whether whole numbers stay for as many rows as an experiment has, and never return, if not `again`."""
    x = column.values
    if column.constant or not np.isfinite(x).all() or not np.array_equal(x, np.rint(x)):
        return False
    borders = np.concatenate([[0], np.flatnonzero(np.diff(x)) + 1, [len(x)]])
    return (again or len(np.unique(x)) == len(borders) - 1) and int(np.diff(borders).min()) >= SHORTEST


def in_blocks(table: Table, column: str = "", used: Collection[str | None] = ()) -> tuple[Table, str, str]:
    """The table in which the rows of each experiment stand together, in their order, the column that tells these
    apart and a note; others as they are.

    Two rigs that write one log take turns, so that their numbers stay for fewer rows than an experiment has; `column`
    is that of the mapping, "" for one whose name says so, or of which each value has an even clock of its own where all
    rows have none, or its name is that of a motor or another part; it is none of those that are `used` already.
    """
    clocks = [] if column else _clocks(table)
    uneven = [t for t in clocks if _evenness(np.diff(t)) <= UNEVEN]
    for name in [column] if column else table.names:
        header = parse_header(name).words
        named, likely = _may_number(header), clocks if _is_rig(header) else uneven
        if name not in table.names or name in used or not (named or column or likely):
            continue
        numbered = labels(table, name) or column_of(table, name)
        if not _takes_turns(numbered):
            continue
        x = numbered.values
        if not named and (_counts_rows(x) or not (column or _has_clocks(numbered, likely))):
            continue
        if len({len(cells) for cells in table.columns}) > 1 or _names_columns(table, name, x):
            continue
        count = len(np.unique(x))
        note = f"the rows of {count} experiments stand among each other: they were parted by column {name!r}"
        return take_rows(table, np.argsort(x, kind="stable"), len(x)), name, note
    return table, "", ""


def _takes_turns(column: Column) -> bool:
    """Whether whole numbers stay for fewer rows than an experiment has, and each comes in as many."""
    x = column.values
    if not len(x) or column.constant or len(x) >= SHORTEST * (np.count_nonzero(np.diff(x)) + 1):
        return False
    whole = np.isfinite(x).all() and np.array_equal(x, np.rint(x))
    return bool(whole and np.unique(x, return_counts=True)[1].min() >= SHORTEST)


def _names_columns(table: Table, name: str, x: np.ndarray) -> bool:
    """Whether numbers (n,) only say which columns have values in a row, as the topic of a message does."""
    alone = 0
    for other in table.names:
        filled = np.isfinite(soft_numbers(table, other)) if other != name else np.zeros(len(x), dtype=bool)
        if filled.any() and not filled.all():
            if np.ptp(x[filled]):
                return False
            alone += 1
    return alone > 1


def _counts_rows(x: np.ndarray) -> bool:
    """Whether numbers (n,) rise row by row and start again after as many rows as an experiment has, as steps of an
    episode do, and the milliseconds of a second.
    """
    steps = np.diff(x)
    return bool(np.median(steps) > 0 and len(x) >= SHORTEST * (np.count_nonzero(steps < 0) + 1))


def _clocks(table: Table) -> list[np.ndarray]:
    """The stamps (n,) of the clocks; the number of the row where there is none."""
    parts = {part for pair in table.joined.values() for part in pair}
    names = [name for name in table.names if name not in parts and is_named_clock(parse_header(name))]
    clocks = [soft_numbers(table, name) for name in names]
    return [t for t in clocks if len(t) and np.isfinite(t).all()] or [
        np.arange(max(map(len, table.columns), default=0))
    ]


def _has_clocks(column: Column, clocks: Sequence[np.ndarray]) -> bool:
    """Whether one of these clocks goes on evenly in the rows of each number alone."""
    if role_by_name(column) in ("input", "output", "both") or is_named_clock(column.header):
        return False
    order = np.argsort(column.values, kind="stable")
    same = np.diff(column.values[order]) == 0
    return any(len(t) == len(order) and _evenness(np.diff(t[order])[same]) >= RISING for t in clocks)


def _evenness(steps: np.ndarray) -> float:
    """The share of the steps (n,) that are near the usual one."""
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    with np.errstate(over="ignore"):  # a damaged stamp is as far off as numbers go
        return float(np.mean(np.abs(steps - usual) <= NEAR * usual)) if usual > 0 else 0.0


def _may_number(header: frozenset[str]) -> bool:
    """Whether the words of a name say that the column numbers or names experiments."""
    return bool(header & _WORDS) and header <= _WORDS | _NUMBER | {"source", "name"}


def _is_rig(header: frozenset[str]) -> bool:
    """Whether the words of a name are those of a part that may take turns with others like it."""
    return bool(header & _RIG) and header <= _RIG | _NUMBER


def labels_of(table: Table) -> dict[str, Column]:
    """The columns that name experiments in words, such as A, A, B, as numbers of these words."""
    likely = [name for name in table.names if _may_number(parse_header(name).words)]
    return {name: column for name in likely if (column := labels(table, name)) is not None}


def labels(table: Table, name: str) -> Column | None:
    """A column of words as numbers of these words; None for one that holds a number."""
    cells = table.columns[table.names.index(name)] if name in table.names else []
    if not len(cells) or not isinstance(cells[0], str) or np.isfinite(soft_numbers(table, name)).any():
        return None
    return Column(parse_header(name), np.unique(np.asarray(list(cells)), return_inverse=True)[1].astype(float))

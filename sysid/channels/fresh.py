"""An output whose sensor is slower than the log: each of its values stands in several rows, of which one is new."""

from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.column import soft_numbers
from sysid.channels.mapping import ChannelMap, Clock
from sysid.data.table import Table

# By chance a change lies in one of k rows with probability 1/k: m of them do so with k^(1 - m).
UNLIKELY = 1e-9
FAULTS = 0.05  # part of the changes that may lie elsewhere, as where a row was lost
LOOK = 1 << 14  # rows
ROWS = "rows"  # a clock of the rows, where the sampling time alone says when they were


def held_notes(table: Table, mapping: ChannelMap) -> tuple[str, ...]:
    """A sentence for each output that is written several times, with what to do."""
    notes = []
    for channel in mapping.output:
        k, at, changes = rows_of_each(soft_numbers(table, channel.column))
        if k > 1 and channel.every == 1:
            notes.append(
                f"column {channel.column!r}: each value is written in {k} rows, as {at} of its {changes} changes lie "
                f"in every {k}th: the sensor is slower than the log, and a fit takes the repeats for the plant's; "
                f"set every = {k} in [[output]] of a mapping, which reads each value once"
            )
    return tuple(notes)


def rows_of_each(values: np.ndarray) -> tuple[int, int, int]:
    """In how many rows each of the values (n,) stands, 1 where they do not repeat so; the changes in step, and all."""
    beginning = rows_of_each(values[:LOOK]) if len(values) > LOOK else (2, 0, 0)  # a long record is looked at briefly
    changes = np.flatnonzero(np.diff(values) != 0) + 1 if beginning[0] > 1 else np.zeros(0, dtype=int)
    k = int(np.median(np.diff(changes))) if len(changes) > 1 else 1
    if k < 2 or not np.isfinite(values).all():
        return 1, 0, len(changes)
    at = int(np.bincount(changes % k).max())
    likely = at >= (1.0 - FAULTS) * len(changes) and (at - 1) * np.log(k) >= -np.log(UNLIKELY)
    return (k if likely else 1), at, len(changes)


def with_fresh_rows(table: Table, mapping: ChannelMap) -> tuple[Table, ChannelMap, tuple[str, ...]]:
    """The table without the repeats of outputs that stand in `every` so many rows, the mapping and notes.

    The rows get a clock where the sampling time alone says when they were. Raises InputError for another role.
    """
    for role, channel, entry in mapping.channels():
        if channel.every > 1 and role != "output":
            raise InputError(
                f"{table.path}: every of [[{entry}]] is {channel.every}, and it is of outputs alone, since inputs are "
                "held; leave it out"
            )
    slow = {channel.column: channel.every for channel in mapping.output if channel.every > 1}
    if not slow:
        return table, mapping, held_notes(table, mapping)
    columns, notes = list(table.columns), []
    for name, every in slow.items():
        j = table.names.index(name)
        values = soft_numbers(table, name)
        fresh = _fresh(values, every)
        columns[j] = np.where(fresh, values, np.nan)
        notes.append(
            f"column {name!r}: of every {every} rows the first with a new value is used, {int(fresh.sum())} rows"
        )
    table = replace(table, columns=tuple(columns))
    if not mapping.clock.column and mapping.clock.Ts is not None:
        n = table.length(next(iter(slow)))
        name = next(text for text in (ROWS, f"{ROWS}_", f"{ROWS}__") if text not in table.names)
        rows = table.rows[table.names.index(next(iter(slow)))]
        t = np.arange(n) * mapping.clock.Ts
        table = replace(table, names=(*table.names, name), columns=(*table.columns, t), rows=(*table.rows, rows))
        mapping = mapping.model_copy(update={"clock": Clock(column=name, unit="s")})
    return table, mapping, tuple(notes)


def _fresh(values: np.ndarray, every: int) -> np.ndarray:
    """Marks (n,) of the first rows of values that stand in `every` rows; one that comes again has several."""
    n = len(values)
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    fresh = np.zeros(n, dtype=bool)
    for start, stop in zip(starts, np.append(starts[1:], n), strict=True):
        fresh[start:stop:every] = True
    if len(starts) > 1:  # the log may begin within a value
        fresh[: starts[1]] = False
        fresh[starts[1] % every : starts[1] : every] = True
    return fresh

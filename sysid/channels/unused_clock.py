"""A clock beside a sampling time that is given: what is told where it says otherwise, or starts again."""

from collections.abc import Collection

import numpy as np

from sysid.channels.clock import is_named_clock
from sysid.channels.column import RISING, Column
from sysid.channels.conversion import seconds
from sysid.channels.experiments import doubt_of_starts, rows_text, starts_of_clock
from sysid.channels.mapping import Clock
from sysid.channels.restarts import shortened
from sysid.channels.roles import Columns
from sysid.data.table import Table

LOST = 1.75  # of the middle step of a clock: a longer one leaves samples out


def notes_on_unused_clock(table: Table, clock: Clock | None, columns: Columns, Ts: float) -> list[str]:
    """A word about a clock that does not say what was given."""
    if clock is None:
        return []
    column = columns[clock.column]
    factor = seconds(clock.unit)
    step, notes = column.step * factor, []
    if abs(step - Ts) > 0.01 * Ts:
        notes.append(f"the sampling time is {Ts:g} s as given; column {column.name!r} steps by {step:.6g} s")
    steps = np.diff(column.values)
    steps[starts_of_clock(table, column.name) - 1] = column.step  # which are experiments of their own
    (jumps,) = np.nonzero((steps > LOST * column.step) | (steps < 0.0))
    if column.step > 0.0 and len(jumps):
        notes.append(
            f"the rows are taken as uniform, as the sampling time is given; column {column.name!r} has {len(jumps)} "
            f"other step(s), the first of {steps[jumps[0]] * factor:.6g} s: leave the sampling time out, or set "
            "it beside the column in [clock] of a mapping, to have them looked after"
        )
    if len(early := shortened(steps, column.step)):
        row = table.rows[table.names.index(column.name)][int(early[0]) + 1]
        notes.append(
            f"column {column.name!r} has {len(early)} shorter step(s), the first of {steps[early[0]] * factor:.6g} s "
            f"to {table.place} {row}, and no longer one makes up for it, as where a run ends and another begins; the "
            "rows are taken as one experiment: where they are several, number them in a column, and name it as "
            "experiment of [range] in a mapping"
        )
    return notes


def count_of_changes(column: Column | None) -> int:
    return 0 if column is None else int(np.count_nonzero(np.diff(column.values)))


def tell_starts(
    table: Table, column: str, starts: np.ndarray, Ts: float | None, unclear: list[str], why: list[str]
) -> None:
    """Says where a clock that is not used starts again: a sampling time that is given joins no two experiments."""
    if doubt := doubt_of_starts(table, column, starts, Ts):
        unclear.append(f"column {column!r}: {doubt}")
    rows = rows_text(table, column, starts.tolist())
    why.append(
        f"column {column!r}, a clock that is not used, starts again or pauses at {rows}: experiments of their own"
    )


def tell_order(
    table: Table,
    columns: Columns,
    counters: Collection[str],
    names: Collection[str],
    unclear: list[str],
    why: list[str],
) -> None:
    """Says where a sampling time that is given would close up rows that were lost, by their counters, or take rows for
    each other's neighbours that a clock among the columns `names` puts elsewhere.
    """
    for name in counters:
        steps, usual = np.diff(columns[name].values), columns[name].step
        (skips,) = np.nonzero(steps > LOST * usual)
        if usual > 0.0 and len(skips) and not np.any(steps <= 0.0):
            row = table.rows[table.names.index(name)][int(skips[0]) + 1]
            lost = int(np.sum(np.rint(steps[skips] / usual) - 1))
            why.append(
                f"column {name!r} skips {lost} number(s), the first before {table.place} {row}: rows that were lost "
                "are closed up, as the sampling time is given; put empty rows in their places to have them marked"
            )
    for name in names:
        steps, ordered = np.diff(columns[name].values), np.diff(np.sort(columns[name].values))
        usual = float(np.median(ordered)) if len(ordered) and is_named_clock(columns[name].header) else 0.0
        even = usual > 0.0 and float(np.mean(np.abs(ordered - usual) <= 0.1 * usual)) >= RISING
        if even and 0.1 < np.mean(steps < 0.0) < 0.9:
            unclear.append(
                f"the rows are not in the order of column {name!r}, which is an even clock once it is sorted; sort the "
                'rows by it and leave --ts out, or set column = "" and Ts under [clock] in a mapping if they are in '
                "order as they stand"
            )

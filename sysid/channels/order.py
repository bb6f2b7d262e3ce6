"""The order of the rows: a log may have its newest row first, as tables of data bases and cloud services do."""

from dataclasses import replace
from typing import Any

import numpy as np

from sysid.channels.clock import is_named_clock
from sysid.channels.clock_choice import choose_clock
from sysid.channels.column import RISING, Column, numeric_columns, words
from sysid.channels.repair import cells_at
from sysid.channels.roles import is_counter
from sysid.data.table import Table

COUNTDOWN = words("remaining left countdown rest restzeit until")  # such a clock falls in a log that is in order


def oldest_first(table: Table) -> Table:
    """The table with its rows turned round, and a note, if its clock falls and none rises; else as it is.

    A counter of samples that falls by one is as good as a clock; one that wraps, or passes midnight, rises in few rows.
    """
    parts = {name for pair in table.joined.values() for name in pair}
    columns = {
        name: column
        for name, column in numeric_columns(table).items()
        if name not in parts and not column.header.has(COUNTDOWN)
    }
    falling = {
        name: replace(column, values=column.values[::-1])
        for name, column in columns.items()
        if len(column.finite) > 2 and np.mean(np.diff(column.finite) <= 0) >= RISING and not column.constant
    }
    if not falling or any(_is_named(c) and c.rising and not c.constant for c in columns.values()):
        return table
    counter = next((c for c in falling.values() if is_counter(c) and c.step == 1.0 and c.ticking), None)
    clocks = (choose_clock({n: c for n, c in falling.items() if c.dated == dated}) for dated in (False, True))
    choice = next((each for each in clocks if each.clock is not None), None)
    name = choice.clock.column if choice is not None and choice.clock is not None else counter.name if counter else ""
    if not name:
        return table
    unsure = choice is not None and (choice.unclear or choose_clock(columns).clock is not None)
    if not _is_named(columns[name]) and counter is None and unsure:
        return table  # a signal as well
    turned = tuple(cells_at(cells, np.arange(len(cells))[::-1]) for cells in table.columns)  # of any length
    numbers: dict[int, Any] = {id(rows): np.asarray(rows)[::-1] for rows in table.rows}
    table = replace(table, columns=turned, rows=tuple(numbers[id(rows)] for rows in table.rows))
    note = f"the rows were turned round: the clock {name!r} falls throughout, so the newest row stood first"
    return replace(table, notes=(*table.notes, note))


def _is_named(column: Column) -> bool:
    return column.dated or is_named_clock(column.header)

"""The order of the rows: a log may have its newest row first, as tables of data bases and cloud services do."""

from dataclasses import replace

import numpy as np

from sysid.channels.clock import is_named_clock
from sysid.channels.clock_choice import choose_clock
from sysid.channels.column import Column, numeric_columns, words
from sysid.channels.repair import take_rows
from sysid.data.table import Table

COUNTDOWN = words("remaining left countdown rest restzeit until")  # such a clock falls in a log that is in order


def oldest_first(table: Table) -> Table:
    """The table with its rows turned round, and a note, if its clock falls throughout and none rises; else as it is."""
    columns = {name: column for name, column in numeric_columns(table).items() if not column.header.has(COUNTDOWN)}
    falling = {
        name: replace(column, values=column.values[::-1])
        for name, column in columns.items()
        if len(column.finite) > 2 and np.all(np.diff(column.finite) <= 0) and not column.constant
    }
    if not falling or any(_is_named(c) and c.rising and not c.constant for c in columns.values()):
        return table
    clocks = (choose_clock({n: c for n, c in falling.items() if c.dated == dated}) for dated in (False, True))
    choice = next((each for each in clocks if each.clock is not None), None)
    if choice is None or choice.clock is None:
        return table
    name = choice.clock.column
    if not _is_named(columns[name]) and (choice.unclear or choose_clock(columns).clock is not None):
        return table  # a signal as well
    n = table.length(name)
    table = take_rows(table, np.arange(n)[::-1], n)
    note = f"the rows were turned round: the clock {name!r} falls throughout, so the newest row stood first"
    return replace(table, notes=(*table.notes, note))


def _is_named(column: Column) -> bool:
    return column.dated or is_named_clock(column.header)

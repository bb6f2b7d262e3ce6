"""The first cell that was meant as a number and is not read as one, among the columns that hold none."""

from collections.abc import Container

import numpy as np

from sysid.channels.values import soft_numbers
from sysid.data.spelling import is_like_a_number, why_no_number
from sysid.data.table import Table

FEW = 10  # cells of a column that are looked at: one of another kind may stand above them


def unread(table: Table, numeric: Container[str], only: str = "") -> str:
    """What stands in that cell of a column that is not `numeric`, with its row and what to do; else nothing.

    `only` is the one column to look at.
    """
    for j, (name, cells) in enumerate(zip(table.names, table.columns, strict=True)):
        if name in numeric or (only and name != only) or not len(cells) or not isinstance(cells[0], str):
            continue
        for k in map(int, np.flatnonzero(np.isnan(soft_numbers(table, name)))[:FEW]):
            if is_like_a_number(cells[k]):
                said = why_no_number(cells[k], name, table.decimal)
                return f"{table.place} {table.rows[j][k]}, column {name!r}: {said}"
    return ""

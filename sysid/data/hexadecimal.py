"""Words in hexadecimal: columns whose prefix 0x says so, and those of which a mapping does."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeGuard

import numpy as np

from sysid.data.table import Table

PREFIXED = re.compile(r"[+-]?0[xX][0-9a-fA-F]{1,13}")  # 13 digits are 52 bits, which a float64 holds
PLAIN = re.compile(r"[+-]?(?:0[xX])?[0-9a-fA-F]{1,13}[hH]?")
DIGITS = 8  # of a word of 32 bits, as a table that read it as a decimal number may hold it


def with_prefixed_words(table: Table) -> Table:
    """The table with numbers for every column of text whose cells all begin with 0x, and a note on them."""
    columns, found = list(table.columns), dict[str, str]()
    for j, (name, cells) in enumerate(zip(table.names, table.columns, strict=True)):
        if not _is_text(cells):
            continue
        first = next((cell.strip() for cell in cells if cell), "")
        if PREFIXED.fullmatch(first) and not isinstance(values := _numbers(cells, PREFIXED), int):
            columns[j], found[name] = values, first
    if not found:
        return table
    names = ", ".join(f"{name!r}" for name in found)
    note = f"read hexadecimal words in {names}, as in {next(iter(found.values()))!r}"
    return replace(table, columns=tuple(columns), hexadecimal=frozenset(found), notes=(*table.notes, note))


def columns_of_words(table: Table) -> list[str]:
    """Columns of text whose cells are all hexadecimal words, with a prefix or without."""
    texts = [(name, cells) for name, cells in zip(table.names, table.columns, strict=True) if _is_text(cells)]
    return [name for name, cells in texts if not isinstance(_numbers(cells, PLAIN), int)]


def with_words(table: Table, names: Sequence[str]) -> Table:
    """The table with numbers for the columns `names` of hexadecimal words, with a prefix or without.

    Raises InputError that names the first cell that is none.
    """
    columns = list(table.columns)
    for name in set(names) & set(table.names) - table.hexadecimal:
        j = table.names.index(name)
        cells = columns[j]
        values = _numbers(cells if _is_text(cells) else [_digits(x) for x in np.asarray(cells, dtype=float)], PLAIN)
        if isinstance(values, int):
            found = str(table.columns[j][values])[:40]
            raise table.error(j, values, f"found {found!r}, which is no hexadecimal word; correct the cell, or base")
        columns[j] = values
    return replace(table, columns=tuple(columns), hexadecimal=table.hexadecimal | set(names))


def _is_text(cells: Sequence[str] | np.ndarray) -> TypeGuard[Sequence[str]]:
    return len(cells) > 0 and isinstance(cells[0], str)


def _digits(x: float) -> str:
    """The digits of a word without letters, which was read as a decimal number; nothing where there is no value."""
    if np.isnan(x):
        return ""
    return str(int(x)) if x == np.rint(x) and 0 <= x < 10**DIGITS else "none"


def _numbers(cells: Sequence[str], form: re.Pattern[str]) -> np.ndarray | int:
    """The words (n,) as numbers, nan for cells without a value; the place of the first cell of another form."""
    known: dict[str, float] = {}
    for k, cell in enumerate(cells):
        if cell not in known:
            text = cell.strip()
            if text and not form.fullmatch(text):
                return k
            known[cell] = float(int(text.rstrip("hH"), 16)) if text else np.nan
    return np.array([known[cell] for cell in cells])

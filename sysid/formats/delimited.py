"""Text tables with comma, semicolon, tab or white space between the columns, with or without a header."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table, is_number

COMMENT = ("#", "%")


class Delimited:
    """Reads .csv, .txt and .dat; writes .csv: names, then one row per sample in full precision, no header text.

    A first row with a cell that is not a number is the header; without it the columns are called 1, 2, ... Blank lines
    and lines that start with # or % are skipped, but count in row numbers. A column without entries (a trailing comma)
    is dropped. In a file with semicolons or tabs a comma may be the decimal mark.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".dat", ".txt")
    written: ClassVar[tuple[str, ...]] = (".csv",)
    headed: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """The table in `path`; raises InputError if it is binary, empty or has rows of different lengths."""
        lines = [
            (number, line)
            for number, line in enumerate(_text(path).splitlines(), start=1)
            if line.strip() and not line.lstrip().startswith(COMMENT)
        ]
        if not lines:
            raise InputError(f"{path} has no rows; give a file with one row a sample")
        separator = _separator(lines[-1][1], lines[0][1])
        rows = [(number, _cells(line, separator)) for number, line in lines]
        decimal = "," if separator in (";", "\t") and _has_decimal_commas(rows[-1][1]) else "."
        header = not all(is_number(cell.replace(decimal, ".")) for cell in rows[0][1] if cell)
        if header and len(rows) == 1:
            raise InputError(f"{path} has a header and no rows under it; give a file with one row a sample")
        rows = _without_empty_columns(rows)
        _check_widths(path, rows)
        names = rows[0][1] if header else [str(j + 1) for j in range(len(rows[0][1]))]
        _check_names(path, names)
        body = rows[1:] if header else rows
        numbers = [number for number, _ in body]
        columns = tuple(list(column) for column in zip(*(cells for _, cells in body), strict=True))
        return Table(path, tuple(names), columns, (numbers,) * len(names), decimal=decimal)

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Columns (N,) by name."""
        import polars

        polars.DataFrame(dict(columns)).write_csv(path)

    def header(self, path: Path) -> str:
        """None: a text table has only columns."""
        return ""


def _text(path: Path) -> str:
    raw = path.read_bytes()
    utf16 = raw.startswith((b"\xff\xfe", b"\xfe\xff"))  # what spreadsheets call "Unicode text"
    try:
        text = raw.decode("utf-16" if utf16 else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # an old degree sign in a header is no reason to refuse the numbers
    strange = next((c for c in text if ord(c) < 32 and c not in "\t\r\n\f\v"), None)
    if strange is not None or "\x7f" in text:
        raise InputError(f"{path} is not a text file (it holds binary bytes); give a text table, or correct the suffix")
    return text


def _separator(line: str, first: str) -> str | None:
    """The separator of the last row, which is always data; None is white space."""
    for mark in (";", "\t", ","):
        if mark in line.strip() or (mark in first.strip() and mark in line):
            # A tab or blank between padded numbers is white space, not an empty cell.
            return None if mark == "\t" and "\t\t" not in line and line != line.strip() else mark
    return None


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return [cell.strip('"') for cell in line.split()]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _has_decimal_commas(cells: list[str]) -> bool:
    return any("," in cell and is_number(cell.replace(",", ".")) for cell in cells)


def _without_empty_columns(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    width = max(len(cells) for _, cells in rows)
    while width > 1 and all(len(cells) < width or not cells[width - 1] for _, cells in rows):
        width -= 1
    return [(number, cells[:width]) for number, cells in rows]


def _check_widths(path: Path, rows: list[tuple[int, list[str]]]) -> None:
    expected = len(rows[0][1])
    for number, cells in rows:
        if len(cells) != expected:
            raise InputError(
                f"{path}, row {number}: found {len(cells)} cells where row {rows[0][0]} has {expected}; "
                "give every row the same number of columns"
            )


def _check_names(path: Path, names: list[str]) -> None:
    for j, name in enumerate(names):
        if name and name in names[:j]:
            raise InputError(f"{path}: two columns are called {name!r}; rename one of them")

"""Whether the marks in the numbers of a text table are decimal marks, or part thousands: 1,234 beside 608."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.base.errors import InputError
from sysid.formats._cells import Part

if TYPE_CHECKING:
    import polars

WITH_COMMA = r"^\s*[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?\s*$"
WITH_POINT = r"^\s*[+-]?(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?\s*$"
NUMBER = {",": WITH_COMMA, ".": WITH_POINT}
THOUSANDS = {",": r"^\s*[+-]?[1-9]\d{0,2},\d{3}\s*$", ".": r"^\s*[+-]?[1-9]\d{0,2}\.\d{3}\s*$"}
SHORT = r"^\s*[+-]?\d{1,3}\s*$"
HUNDREDS = r"^\s*[+-]?[1-9]\d\d\s*$"
ZEROED = r"\.\d\d0\s*$"  # nobody who leaves out the mark of 0 keeps the zeros of 2.500
LONG = r"^\s*[+-]?\d{4,}\s*$"  # nobody who parts thousands writes 1234

Cell = tuple[int, str]  # row of the file and text


class Marks:
    """What the marks `decimal` in the cells of `width` columns may mean.

    A number such as 0,5 or 12,25 has a decimal mark beyond doubt. One such as 1,234 may be read in two ways. The first
    way is right if its column has numbers of the first kind, or whole ones without a mark above 999.
    """

    def __init__(self, decimal: str, width: int) -> None:
        self.decimal = decimal
        self.clear = [False] * width
        self.parted: list[Cell | None] = [None] * width
        self.short: list[Cell | None] = [None] * width
        self.hundreds = [False] * width
        self.zeroed = [False] * width

    def look(self, block: Part) -> None:
        """Takes the marked numbers of a block."""
        if self.decimal == "." and any(self.clear):
            return
        for j, column in enumerate(block.columns):
            if self.clear[j] or not column.str.contains(self.decimal, literal=True).any():
                continue
            parted = column.str.contains(THOUSANDS[self.decimal])
            self.clear[j] = bool((column.str.contains(NUMBER[self.decimal]) & ~parted).any())
            self.zeroed[j] = self.zeroed[j] or bool((column.str.contains(ZEROED) & parted).any())
            if self.parted[j] is None and parted.any():
                k = int(parted.arg_true()[0])
                self.parted[j] = int(block.rows[k]), column[k]

    def check(self, path: Path, names: Sequence[str], separator: str | None, blocks: Iterable[Part]) -> None:
        """Raises InputError for a column whose marks may part thousands; `blocks` are looked at where that is open."""
        sure = any(self.clear)
        found = [j for j, cell in enumerate(self.parted) if cell is not None and not self.clear[j]]
        if not found or (sure and self.decimal == "."):
            return
        # A semicolon parts the cells because the comma is the decimal mark, unless numbers of one column differ in it.
        lone = self.decimal == "," and separator != ";" and not sure
        for block in blocks:
            for j in found:
                self._look_for_whole(j, block)
        for j in found:
            mixed = self.short[j] is not None and not self.clear[j]
            doubtful = self.hundreds[j] or self.zeroed[j] or (not sure and self.decimal == ",")
            if lone or (mixed and doubtful):
                raise self._error(path, names[j], j)

    def _look_for_whole(self, j: int, block: Part) -> None:
        column = block.columns[j]
        if self.short[j] is None and (k := first_match(column, SHORT)) is not None:
            self.short[j] = int(block.rows[k]), column[k]
        if not self.hundreds[j] and (k := first_match(column, HUNDREDS)) is not None:
            self.hundreds[j], self.short[j] = True, (int(block.rows[k]), column[k])
        self.clear[j] = self.clear[j] or bool(column.str.contains(LONG).any())

    def _error(self, path: Path, name: str, j: int) -> InputError:
        parted, short = self.parted[j], self.short[j]
        assert parted is not None
        row, text = parted[0], parted[1].strip()
        one, other = (text.replace(self.decimal, mark) for mark in (".", ""))
        beside = f", as row {short[0]} has {short[1].strip()!r}" if short else ""
        return InputError(
            f"{path}, row {row}, column {name!r}: found {text!r}, whose {'comma' if self.decimal == ',' else 'point'} "
            f"may be a decimal mark ({one}) or part thousands ({other}){beside}; write the numbers with a decimal "
            "point and without thousands marks"
        )


def first_match(column: "polars.Series", pattern: str) -> int | None:
    """The place of the first cell that matches."""
    places = column.str.contains(pattern).arg_true()
    return int(places[0]) if len(places) else None

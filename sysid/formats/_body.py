"""The rows of a text table below its header as columns of numbers, and what the marks in these numbers mean."""

import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Texts
from sysid.formats._cells import Layout, Part, blocks, drop_cut_line, numbers, part
from sysid.formats._long_table import may_be_long

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
            thousands = column.str.contains(THOUSANDS[self.decimal])
            self.clear[j] = bool((column.str.contains(NUMBER[self.decimal]) & ~thousands).any())
            self.zeroed[j] = self.zeroed[j] or bool((column.str.contains(ZEROED) & thousands).any())
            if self.parted[j] is None and thousands.any():
                k = int(thousands.arg_true()[0])
                self.parted[j] = int(block.rows[k]), column[k]

    def check(self, path: Path, names: Sequence[str], separator: str | None, blocks: Iterable[Part]) -> None:
        """Raises InputError for a column whose marks may part thousands; `blocks` are looked at where that is open."""
        sure = any(self.clear)
        candidates = [j for j, cell in enumerate(self.parted) if cell is not None and not self.clear[j]]
        if not candidates or (sure and self.decimal == "."):
            return
        # A semicolon parts the cells because the comma is the decimal mark, unless numbers of one column differ in it.
        lone = self.decimal == "," and separator != ";" and not sure
        for block in blocks:
            for j in candidates:
                self._look_for_whole(j, block)
        for j in candidates:
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
        """The error for the first number of a column that may be read in two ways, with both readings."""
        marked, short = self.parted[j], self.short[j]
        assert marked is not None
        row, text = marked[0], marked[1].strip()
        decimal, plain = (text.replace(self.decimal, mark) for mark in (".", ""))
        comparison = f", as row {short[0]} has {short[1].strip()!r}" if short else ""
        return InputError(
            f"{path}, row {row}, column {name!r}: found {text!r}, whose {'comma' if self.decimal == ',' else 'point'} "
            f"may be a decimal mark ({decimal}) or part thousands ({plain}){comparison}; write the numbers with a "
            "decimal point and without thousands marks"
        )


def first_match(column: "polars.Series", pattern: str) -> int | None:
    """The place of the first cell that matches."""
    places = column.str.contains(pattern).arg_true()
    return int(places[0]) if len(places) else None


class Body:
    """Reads the rows of the columns `names` from row `start` on; `notes` says what it left out or assumed."""

    def __init__(self, path: Path, names: Sequence[str], layout: Layout, start: int) -> None:
        self.path, self.names, self.layout, self.start = path, names, layout, start
        self.decimal = "."
        self.notes: list[str] = []
        self.rows: Sequence[int] = ()
        self.columns: list[Sequence[str] | np.ndarray] = []

    def read(self) -> None:
        """Fills `rows` and `columns`; a column with a cell that is not a number stays text."""
        comma = self._pass()
        if comma:  # a comma inside a cell: it is read once more, with the comma as the decimal mark
            self.decimal = ","
            self._check_commas(comma)
            self._pass()
            self.notes.append(f"read commas as decimal marks, as in {comma[1]!r} in row {comma[0]}")

    def _pass(self) -> tuple[int, str] | None:
        """Reads all columns; instead row and text of the first number with a comma, if that is not the mark yet."""
        parts_of: list[list[np.ndarray] | None] = [[] for _ in range(self.layout.width)]
        rows: list[Sequence[int]] = []
        marks = Marks(self.decimal, self.layout.width)
        for block in self._parts():
            rows.append(block.rows)
            marks.look(block)
            for j, column in enumerate(block.columns):
                values = numbers(column, self.decimal)
                if values is None and self.decimal == "." and (k := first_match(column, WITH_COMMA)) is not None:
                    return int(block.rows[k]), column[k]
                parts = parts_of[j]
                if values is None or parts is None:
                    parts_of[j] = None
                else:
                    parts.append(values)
        marks.check(self.path, self.names, self.layout.separator, self._parts())
        texts = self._texts([j for j, parts in enumerate(parts_of) if parts is None])
        self.columns = []
        for j in range(self.layout.width):
            parts, parts_of[j] = parts_of[j], None  # one column after the other: no number is held twice for long
            self.columns.append(texts[j] if parts is None else np.concatenate(parts) if parts else np.empty(0))
        self.rows = _join_rows(rows)
        if len(texts) == self.layout.width:
            self._drop_names(list(texts.values()))
        return None

    def _drop_names(self, texts: list[Texts]) -> None:
        """Leaves out rows that hold the names again, which a logger writes as it starts, where a clock tells what they
        part, a column that rises in all rows, or falls at each of them and nowhere else; and those of a long table,
        which has one for each block of series.
        """
        named = ["" if name == str(j) else name for j, name in enumerate(self.names, 1)]  # a column without a name
        again = np.logical_and.reduce([text.equal(name) for text, name in zip(texts, named, strict=True)])
        kept = np.flatnonzero(~again)
        if not again.any() or not len(kept):
            return
        places = np.unique(np.cumsum(~again)[again])  # the rows behind them, among those that are kept
        columns = [text.taken(kept) for text in texts]
        values = [text.numbers(self.decimal) for text in columns]
        starts = places[(places > 0) & (places < len(kept))].tolist()
        clocks = [x for x in values if (np.flatnonzero(np.diff(x) <= 0) + 1).tolist() in ([], starts)]
        if not (may_be_long(self.names) or any(np.isfinite(x).all() for x in clocks)):
            return
        self.columns = [text if np.isnan(x).any() else x for text, x in zip(columns, values, strict=True)]
        shown = ", ".join(str(self.rows[int(k)]) for k in np.flatnonzero(again)[:6])
        self.notes.append(f"left out {int(again.sum())} row(s) that hold the names again (row {shown})")
        self.rows = array("q", [self.rows[int(k)] for k in kept])

    def _texts(self, columns: list[int]) -> dict[int, Texts]:
        import polars

        texts: dict[int, list[polars.Series]] = {j: [] for j in columns}
        if columns:
            for block in self._parts():
                for j in columns:
                    texts[j].append(block.columns[j].str.strip_chars())
        return {j: Texts(polars.concat(parts)) for j, parts in texts.items()}

    def _parts(self) -> Iterator[Part]:
        """The blocks; a last line that was cut is left out and noted."""
        self.notes = []
        source = blocks(self.path)
        following = next(source, None)
        while following is not None:
            (row, block), following = following, next(source, None)
            if row < self.start:
                block = block.split(b"\n", self.start - row)[-1]
                row = self.start
            if following is None and not block.endswith(b"\n"):
                block = self._without_cut_line(row, block)
            if block:
                yield part(self.path, row, block, self.layout)

    def _without_cut_line(self, row: int, block: bytes) -> bytes:
        last = row + block.count(b"\n")
        block, was_cut = drop_cut_line(block, self.layout, self.decimal)
        if was_cut:
            self.notes.append(f"left out row {last}, the last, which is cut off")
        elif was_cut is None:
            self.notes.append(
                f"row {last}, the last, has no line end; if the file was cut there, its last number is wrong"
            )
        return block

    def _check_commas(self, comma: tuple[int, str]) -> None:
        """Refuses a file with both marks."""
        for block in self._parts():
            for j, column in enumerate(block.columns):
                if (k := first_match(column, WITH_POINT)) is not None:
                    raise InputError(
                        f"{self.path}, row {block.rows[k]}, column {self.names[j]!r}: found {column[k]!r} with a point "
                        f"where row {comma[0]} has {comma[1]!r} with a comma; {_one_mark(column[k], comma[1])}"
                    )


def _one_mark(point: str, comma: str) -> str:
    """What to do about two numbers with different marks, of which one may part thousands."""
    parts = [re.match(THOUSANDS[mark], text) is not None for mark, text in ((".", point), (",", comma))]
    if parts[0] == parts[1]:
        return "write all numbers with a decimal point"
    name, text = ("point", point) if parts[0] else ("comma", comma)
    return (
        f"if the {name} in {text.strip()!r} parts thousands, remove the thousands marks, else write all numbers with a "
        "decimal point"
    )


def _join_rows(rows: list[Sequence[int]]) -> Sequence[int]:
    """The row numbers of all blocks; one range where no line was skipped."""
    rows = [rows_of_part for rows_of_part in rows if len(rows_of_part)]
    if not rows:
        return ()
    span = range(rows[0][0], rows[-1][-1] + 1)
    if len(span) == sum(map(len, rows)):
        return span
    numbers = array("q")
    for rows_of_part in rows:
        numbers.extend(rows_of_part)
    return numbers

"""Cells of text tables: polars reads blocks of regular lines, and the csv module reads the others line by line.

Both give the same texts, so the numbers and the messages do not depend on which of them read a line.
"""

import csv
import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import forked
from sysid.base.errors import InputError
from sysid.data.table import is_number
from sysid.formats._text import COMMENT, data_lines, is_comment

if TYPE_CHECKING:
    import polars

ODD = (*COMMENT, b"\n\n", b"\n ", b"\n\t", b"\f", b"\v")  # a line may be a comment, blank, or start with a blank
NEAR = 1 << 16  # bytes in which they are looked for
LIKE = 200  # lines before the last one that show what a whole line looks like


@dataclass(frozen=True)
class Layout:
    """How a line is split: `separator` (None is white space), number of cells, and a row that shows that number."""

    separator: str | None
    width: int
    first: int


@dataclass(frozen=True)
class Part:
    """The cells of one block, column by column, and their rows in the file."""

    rows: Sequence[int]
    columns: "list[polars.Series]"


def cells(line: str, separator: str | None) -> list[str]:
    """The cells of a line without the blanks around them. Raises csv.Error for a quote that is never closed."""
    if separator is None:
        return [cell.strip('"') for cell in line.split()]
    reader = csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True)
    return [cell.strip() for cell in next(reader)]


def split(path: Path, row: int, line: str, separator: str | None) -> list[str]:
    """The cells of a row of the file; raises InputError with its number if its quotes are wrong."""
    try:
        return cells(line, separator)
    except csv.Error as error:
        remedy = "shorten or remove its longest cell" if "larger than" in str(error) else "correct its quotes"
        raise InputError(
            f"{path}, row {row}: found a row that cannot be split into cells ({error}); {remedy}"
        ) from None


def part(path: Path, row: int, block: bytes, layout: Layout) -> Part:
    """The cells of the lines in `block`, the first of which is `row` of the file.

    Raises InputError, which names the row, for a line with another number of cells than the layout's.
    """
    forked.check()
    if block and not block.endswith(b"\n"):
        block += b"\n"
    rows: Sequence[int] = range(row, row + block.count(b"\n"))
    if any(mark in block for mark in ODD) or block[:1].isspace():
        lines = list(data_lines(row, block))
        rows = array("q", [number for number, _ in lines])
        block = b"".join(line + b"\n" for _, line in lines)
    columns = _regular(block, len(rows), layout)
    return Part(rows, _line_by_line(path, rows, block, layout) if columns is None else columns)


def _regular(block: bytes, count: int, layout: Layout) -> "list[polars.Series] | None":
    """The columns of `count` lines that all have the layout's number of cells and no quotes; else None."""
    import polars

    separator = (layout.separator or " ").encode()
    if not count or (b'"' in block and not _whole_cells_quoted(block, separator)):
        return None
    block = block.replace(b'"', b"")
    if layout.separator is None:
        block = _single_blanks(block)
    if layout.separator is not None and block.count(separator) == layout.width * count:
        block = block.replace(separator + b"\n", b"\n")  # a separator at the end of every line
    if block.count(separator) != (layout.width - 1) * count:
        return None
    try:
        frame = polars.read_csv(
            block,
            has_header=False,
            separator=separator.decode(),
            quote_char=None,
            schema={str(j): polars.String for j in range(layout.width)},
        )
    except polars.exceptions.PolarsError:  # a line with more cells; so none has fewer either, as the sum is right
        return None
    return None if frame.height != count else [column.fill_null("") for column in frame.get_columns()]


def _whole_cells_quoted(block: bytes, separator: bytes) -> bool:
    """Whether quotes stand around whole cells alone, with no separator, line end or quote between the two."""
    text = np.frombuffer(block, dtype=np.uint8)
    quotes, ends = np.flatnonzero(text == ord('"')), np.flatnonzero((text == separator[0]) | (text == ord("\n")))
    if len(quotes) % 2:
        return False
    first, last = quotes[::2], quotes[1::2]
    starts = np.concatenate([[0], ends + 1])  # of cells; a block ends with a line end
    place = np.searchsorted(ends, first)
    return bool(np.all(starts[place] == first) and np.all(ends[np.minimum(place, len(ends) - 1)] == last + 1))


def _single_blanks(block: bytes) -> bytes:
    block = block.replace(b"\t", b" ")
    while b"  " in block:
        block = block.replace(b"  ", b" ")
    return block.replace(b"\n ", b"\n").replace(b" \n", b"\n").lstrip(b" ")


def _line_by_line(path: Path, rows: Sequence[int], block: bytes, layout: Layout) -> "list[polars.Series]":
    import polars

    found = []
    for number, line in zip(rows, block.decode().split("\n"), strict=False):
        row = trimmed(split(path, number, line, layout.separator), layout.width)
        if len(row) != layout.width:
            raise InputError(
                f"{path}, row {number}: found {len(row)} cells where row {layout.first} has {layout.width}; "
                "give every row the same number of columns"
            )
        found.append(row)
    return [polars.Series(str(j), [row[j] for row in found], polars.String) for j in range(layout.width)]


def trimmed(row: list[str], width: int) -> list[str]:
    """A row without the empty cells behind its first `width` ones."""
    while len(row) > width and not row[-1]:
        row = row[:-1]
    return row


def numbers(column: "polars.Series", decimal: str) -> np.ndarray | None:
    """A column of texts as float64, None if one of them is not a number."""
    import polars

    if decimal == ",":
        column = column.str.replace_all(",", ".", literal=True)
    values = column.cast(polars.Float64, strict=False)
    if values.null_count():
        values = column.str.strip_chars().cast(polars.Float64, strict=False)
    return None if values.null_count() else values.to_numpy()


def cut(block: bytes, layout: Layout, decimal: str) -> tuple[bytes, bool | None]:
    """The last block of a file without its last line if that was cut, and whether it was: None if it cannot be told.

    A last line without a line end was cut if it has fewer cells than the others, or if its last cell has other digits
    behind the point where all the others agree.
    """
    before, _, last = block.rpartition(b"\n")
    if not last.strip() or is_comment(last.lstrip()):
        return block, False
    near = before if len(before) <= NEAR else before[-NEAR:].partition(b"\n")[2]
    shapes = {_shape(line, layout, decimal) for _, line in list(data_lines(1, near))[-LIKE:]}
    own = _shape(last, layout, decimal)
    if own[0] != layout.width or (shapes and own[1] is None and None not in {shape for _, shape in shapes}):
        return before + b"\n", True
    if len(shapes) == 1:
        (shape,) = shapes
        whole = shape == own and own[1] not in (None, "")
        return (block, False) if whole else (block, None) if shape == own else (before + b"\n", True)
    return block, None


def _shape(line: bytes, layout: Layout, decimal: str) -> tuple[int, str | None]:
    """Number of cells, and the last cell from its point on with 0 for every digit; None if it is not a number."""
    try:
        row = trimmed(cells(line.decode(errors="replace"), layout.separator), layout.width)
    except csv.Error:
        return 0, None
    text = row[-1].replace(decimal, ".") if row else ""
    return len(row), re.sub(r"\d", "0", text[text.index(".") :]) if "." in text and is_number(text) else (
        "" if is_number(text) else None
    )

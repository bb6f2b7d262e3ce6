"""Text files as blocks of whole lines in UTF-8, and their cells column by column.

polars reads blocks of regular lines, and the csv module reads the others line by line. Both give the same texts, so the
numbers and the messages do not depend on which of them read a line.
"""

import codecs
import csv
import io
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from sysid.base import tables
from sysid.base.errors import InputError
from sysid.data.table import is_number

if TYPE_CHECKING:
    import polars

BLOCK = 1 << 23  # bytes: large enough for polars' threads, small beside the numbers of a long record
COMMENT = (b"#", b"%")
ERRORS = (b"#N/A", b"#DIV/0!", b"#VALUE!", b"#REF!", b"#NAME?", b"#NUM!", b"#NULL!")  # of a spreadsheet: no comments
BLANKS = bytes.maketrans(b"\f\v", b"  ")
MINUS = re.compile("\u2212(?=[0-9.,])".encode())  # as people print numbers
TEXT = bytes(c for c in range(256) if (c >= 32 and c != 127) or c in b"\t\n\f\v")


def blocks(path: Path, size: int = BLOCK) -> Iterator[tuple[int, bytes]]:
    """Blocks of whole lines with the row number of their first line; the last one may lack its line end.

    Raises InputError for binary bytes and for UTF-16 text that is cut within a character.
    """
    row = 1
    with path.open("rb") as file:
        for raw in _whole_lines(_decode(file, path), size):
            block = _plain(raw)
            strange = block.translate(None, TEXT)
            if strange:
                place = row + block[: block.index(strange[:1])].count(b"\n")
                raise InputError(
                    f"{path} is not a text file (it holds binary bytes, the first in row {place}); give a text table, "
                    "or correct the suffix"
                )
            yield row, block
            row += block.count(b"\n")
            if len(block) - block.rfind(b"\n") > LONGEST_LINE:
                raise InputError(
                    f"{path}, row {row}: found a line of over {LONGEST_LINE >> 20} MB, which is no row of a table; "
                    "give a text table with one row a sample"
                )


def _decode(file: BinaryIO, path: Path) -> BinaryIO:
    """The file without a byte order mark; UTF-16, which spreadsheets call Unicode text, as UTF-8."""
    head = file.read(3)
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raw = head + file.read()
        try:
            return io.BytesIO(raw.decode("utf-16").encode())
        except UnicodeDecodeError as error:
            row = raw[: error.start].decode("utf-16", "ignore").count("\n") + 1
            raise InputError(
                f"{path}, row {row}: found half a character of UTF-16 text; the file is cut or damaged; save it again"
            ) from None
    file.seek(3 if head == codecs.BOM_UTF8 else 0)
    return file


LONGEST_LINE = 1 << 22  # bytes; a row of 100,000 numbers is half as long


def _whole_lines(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Pieces of about `size` bytes; what follows the last line end belongs to the last piece, which a line that is too
    long ends.
    """
    lines = rest = b""
    while piece := file.read(size):
        piece = rest + piece
        end = piece.rfind(b"\n") + 1 or piece.rfind(b"\r", 0, -1) + 1
        rest = piece[end:]
        if len(rest) > LONGEST_LINE:  # or a hole of a file, gigabytes without a line end, would be read to its end
            rest = piece
            break
        if end:
            if lines:
                yield lines
            lines = piece[:end]
    if lines or rest:
        yield lines + rest


def _plain(block: bytes) -> bytes:
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not block.isascii():
        try:
            block.decode()
        except UnicodeDecodeError:
            block = _of_old_codes(block)  # an old degree sign in a header is no reason to refuse the numbers
        block = MINUS.sub(b"-", block)
    return block


def _of_old_codes(block: bytes) -> bytes:
    """Text of GB 2312, else of Windows-1252, or of latin-1 where a byte has no letter in it, as UTF-8.

    In GB 2312 high bytes come in pairs, which letters with accents and a degree sign between ASCII letters do not.
    """
    for code in ("gb2312", "cp1252"):
        try:
            return block.decode(code).encode()
        except UnicodeDecodeError:
            continue
    return block.decode("latin-1").encode()


def is_comment(line: bytes) -> bool:
    """Whether a line without blanks in front is a comment."""
    return line.startswith(COMMENT) and not line.startswith(ERRORS)


def data_lines(row: int, block: bytes) -> Iterator[tuple[int, bytes]]:
    """The lines of a block that are neither blank nor a comment (# or % at their start), with their row numbers."""
    for number, line in enumerate(block.split(b"\n"), start=row):
        if (text := line.strip()) and not is_comment(text):
            yield number, line.translate(BLANKS)


def comments(path: Path) -> list[str]:
    """Texts of the comment lines above the first line of data, without their marks and the blanks around them."""
    texts: list[str] = []
    for _, block in blocks(path, 1 << 16):
        for line in block.split(b"\n"):
            text = line.strip()
            if text and not is_comment(text):
                return texts
            texts += [text[1:].decode().strip()] if text else []
    return texts


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
    tables.check_fork()
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
    """The columns of lines that differ, or have quotes; raises InputError with the row of a line that is wrong."""
    import polars

    cells_of_rows = []
    for number, line in zip(rows, block.decode().split("\n"), strict=False):
        row = trim(split(path, number, line, layout.separator), layout.width)
        if len(row) != layout.width:
            raise InputError(
                f"{path}, row {number}: found {len(row)} cell{'s'[: len(row) - 1]} where row {layout.first} has "
                f"{layout.width}; give every row the same number of columns"
            )
        cells_of_rows.append(row)
    return [polars.Series(str(j), [row[j] for row in cells_of_rows], polars.String) for j in range(layout.width)]


def trim(row: list[str], width: int) -> list[str]:
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


def drop_cut_line(block: bytes, layout: Layout, decimal: str) -> tuple[bytes, bool | None]:
    """The last block of a file without its last line if that was cut, and whether it was: None if it cannot be told.

    A last line without a line end was cut if it has fewer cells than the others, or if its last cell has other digits
    behind the point where all the others agree.
    """
    head, _, last = block.rpartition(b"\n")
    if not last.strip() or is_comment(last.lstrip()):
        return block, False
    tail = head if len(head) <= NEAR else head[-NEAR:].partition(b"\n")[2]
    shapes = {_shape(line, layout, decimal) for _, line in list(data_lines(1, tail))[-LIKE:]}
    width, form = _shape(last, layout, decimal)
    if width != layout.width or (shapes and form is None and None not in {shape for _, shape in shapes}):
        return head + b"\n", True
    if len(shapes) != 1:
        return block, None
    if shapes != {(width, form)}:
        return head + b"\n", True
    return block, None if form in (None, "") else False


def _shape(line: bytes, layout: Layout, decimal: str) -> tuple[int, str | None]:
    """Number of cells, and the last cell from its point on with 0 for every digit; None if it is not a number."""
    try:
        row = trim(cells(line.decode(errors="replace"), layout.separator), layout.width)
    except csv.Error:
        return 0, None
    text = row[-1].replace(decimal, ".") if row else ""
    if not is_number(text):
        return len(row), None
    return len(row), re.sub(r"\d", "0", text[text.index(".") :]) if "." in text else ""

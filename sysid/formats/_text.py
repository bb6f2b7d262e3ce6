"""Text files as blocks of whole lines in UTF-8 with \\n at their ends, whatever the file's own encoding is."""

import codecs
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from sysid.base.errors import InputError

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
        for raw in _whole_lines(_decoded(file, path), size):
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


def _decoded(file: BinaryIO, path: Path) -> BinaryIO:
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


def _whole_lines(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Pieces of about `size` bytes; what follows the last line end belongs to the last piece."""
    whole = rest = b""
    while piece := file.read(size):
        piece = rest + piece
        end = piece.rfind(b"\n") + 1
        rest = piece[end:]
        if end:
            if whole:
                yield whole
            whole = piece[:end]
    if whole or rest:
        yield whole + rest


def _plain(block: bytes) -> bytes:
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not block.isascii():
        try:
            block.decode()
        except UnicodeDecodeError:
            block = _of_windows(block)  # an old degree sign in a header is no reason to refuse the numbers
        block = MINUS.sub(b"-", block)
    return block


def _of_windows(block: bytes) -> bytes:
    """Text of Windows-1252, or of latin-1 where a byte has no letter in it, as UTF-8."""
    try:
        return block.decode("cp1252").encode()
    except UnicodeDecodeError:
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
    found: list[str] = []
    for _, block in blocks(path, 1 << 16):
        for line in block.split(b"\n"):
            text = line.strip()
            if text and not is_comment(text):
                return found
            found += [text[1:].decode().strip()] if text else []
    return found

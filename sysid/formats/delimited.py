"""Text tables with comma, semicolon, tab or white space between the columns, with or without a header."""

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base import tables
from sysid.base.errors import InputError
from sysid.data.table import Table, is_number
from sysid.formats._body import WITH_COMMA, Body
from sysid.formats._cells import Layout, blocks, cells, comments, data_lines, split, trim
from sysid.formats._oscilloscope import Preamble, preamble_of
from sysid.formats._unit_names import is_unit, units_of
from sysid.formats.serial_capture import SerialCapture, looks_like_one

HEADER = "qpal:"
AMBIGUOUS = (".dat", ".txt")  # of tables and of captures
SAMPLE = 200  # lines that show the separator and the header
FEW = 3  # rows that tell nothing about the others
UNIT_MARK = re.compile(r"\s*[\[({/].*|$", re.DOTALL)  # what may be a unit, behind a name
SEPARATOR = re.compile(r'"?sep=([,;\t|])"?', re.IGNORECASE)  # what Excel writes as the first line, and takes it from


@dataclass(frozen=True)
class Head:
    """What the first lines say: names, their units, how rows are split, and the row where the numbers begin."""

    names: tuple[str, ...]
    units: Mapping[str, str]
    layout: Layout
    start: int
    preamble: Preamble | None = None
    again: Mapping[str, str] = field(default_factory=dict)  # names that the header gives to a column before, too
    banner: tuple[str, ...] = ()  # lines above the names that are no comments


class Delimited:
    """Reads .csv, .tsv, .txt and .dat; writes .csv: names, then one row per sample in full precision.

    A first row with a cell that is not a number is the header; without it the columns are called 1, 2, ..., or by the
    comment line above them that has a name for each. Rows of fewer cells above the names, a title or a date, are left
    out. A name that comes again gets its number, `Time` and `Time 2`; where both columns hold the same, one is read. A
    second row that holds only units gives the units. Blank lines and lines that start with # or % are skipped, but
    count in row numbers; so does Excel's line `sep=;`. A column without entries (a trailing comma) is dropped. A comma
    inside the cells is the decimal mark. The header of `write` stands in comment lines `# qpal: ...` at the top, which
    other programs skip or show.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".dat", ".tsv", ".txt")
    written: ClassVar[tuple[str, ...]] = (".csv",)
    headed: ClassVar[bool] = True

    def read(self, path: Path) -> Table:
        """The table in `path`; raises InputError if it is binary, empty or has rows of different lengths."""
        return _read(path) if path.suffix.lower() not in AMBIGUOUS else _read_either(path)

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Columns (N,) by name, below the header."""
        import polars

        tables.check_fork()
        with path.open("wb") as file:
            for line in header.split("\n") if header else ():
                file.write(f"# {HEADER} {line}\n".encode())
            polars.DataFrame(dict(columns)).fill_nan(None).write_csv(file)

    def header(self, path: Path) -> str:
        """The comment lines `# qpal: ...` at the top of the file."""
        try:
            lines_above = comments(path)
        except InputError:  # binary bytes among the lines of a capture
            return ""
        lines = [line.removeprefix(HEADER) for line in lines_above if line.startswith(HEADER)]
        return "\n".join(line.removeprefix(" ") for line in lines)


def _read(path: Path) -> Table:
    """The table of a file whose rows have one length."""
    head = _head(path)
    body = Body(path, head.names, head.layout, head.start)
    body.read()
    if not len(body.rows):
        raise InputError(f"{path} has no whole row of numbers; give a file with one row a sample")
    columns = dict(zip(head.names, body.columns, strict=True))
    notes = [*body.notes, *_settle_repeated(columns, head.again)]
    if head.banner:
        notes.append(f"skipped what stands above the names, which are in row {head.layout.first}")
    rows = (body.rows,) * len(columns)
    lines_above = (*(line for line in comments(path) if not line.startswith(HEADER)), *head.banner)
    table = Table(
        path,
        tuple(columns),
        tuple(columns.values()),
        rows,
        decimal=body.decimal,
        units={name: unit for name, unit in head.units.items() if name in columns},
        notes=tuple(notes),
        comments=lines_above,
    )
    return table if head.preamble is None else head.preamble.finished(table)


def _read_either(path: Path) -> Table:
    """The table in a file that may as well be what a microcontroller printed, which its content tells."""
    with path.open("rb") as file:
        if looks_like_one(file.read(1 << 16)):
            return SerialCapture().read(path)
    try:
        return _read(path)
    except InputError as error:
        try:  # rows of several lengths or binary bytes are few garbled lines in a capture
            return SerialCapture().read(path)
        except InputError:
            raise error from None


def _head(path: Path) -> Head:
    """The head of the file, from its first lines; raises InputError for a file without rows or with doubtful names."""
    every = (entry for row, block in blocks(path) for entry in data_lines(row, block))
    sample = [(row, line.decode()) for row, line in islice(every, SAMPLE)]
    sep_line = SEPARATOR.fullmatch(sample[0][1].strip(" ")) if sample else None
    sep_row = sample.pop(0)[0] if sep_line else 0
    if not sample:
        raise InputError(f"{path} has no rows; give a file with one row a sample")
    lines = [line for _, line in sample]
    preamble = preamble_of([_split(line, ",") for line in lines]) if "," in lines[0] else None
    if preamble is not None:
        row = sample[preamble.first][0]
        layout = Layout(",", preamble.width, row)
        return Head(preamble.names, preamble.units, layout, row, preamble)
    separator = sep_line[1] if sep_line else _separator(lines[0], lines[1:] or lines)
    rows = [split(path, *sample[0], separator), *(_split(line, separator) for line in lines[1:])]
    above = _rows_above_names(rows)
    banner, sample, rows = tuple(line for _, line in sample[:above]), sample[above:], rows[above:]
    width = max(map(len, rows))
    while width > 1 and all(len(row) < width or not row[width - 1] for row in rows):
        width -= 1
    layout = Layout(separator, min(len(rows[0]), width), sample[0][0])
    first, second_row = trim(rows[0], layout.width), rows[1] if len(rows) > 1 else []
    has_whole = any(cell.lstrip("+-").isdigit() for row in rows[1:] for cell in row)
    if _is_count(first) and len(rows) > FEW and not has_whole:
        raise InputError(
            f"{path}, row {sample[0][0]}: found {', '.join(first)[:40]}, which may be names or the first sample, as no "
            "number below is whole; write names into it, or remove it"
        )
    if not _is_header(first, second_row):
        names = _names_in_comment(path, layout) or [str(j + 1) for j in range(layout.width)]
        return Head(tuple(names), units_of(names), layout, sep_row + 1)
    if len(rows) == 1:
        raise InputError(f"{path} has a header and no rows under it; give a file with one row a sample")
    names, again = _numbered([name or str(j + 1) for j, name in enumerate(first)])
    units, start = units_of(names), sample[0][0] + 1
    if unit_row := _units_of_row(second_row):
        units |= {name: unit for name, unit in zip(names, unit_row, strict=False) if unit}
        start = sample[1][0] + 1
    return Head(tuple(names), units, layout, start, again=again, banner=banner)


def _rows_above_names(rows: Sequence[Sequence[str]]) -> int:
    """How many rows of a title, an operator or a date stand above the names: all have fewer cells than the table."""
    filled = [sum(map(bool, row)) for row in rows]
    width = Counter(max((j + 1 for j, cell in enumerate(row) if cell), default=0) for row in rows).most_common(1)[0][0]
    first = next((k for k, count in enumerate(filled) if count >= width), 0)
    if filled[first] != width or first + 1 >= len(rows) or any(map(_is_cell_of_numbers, rows[first])):
        return 0
    return first if any(map(_is_cell_of_numbers, rows[first + 1])) and not _units_of_row(rows[first]) else 0


def _split(line: str, separator: str | None) -> list[str]:
    try:
        return cells(line, separator)
    except csv.Error:  # told with its row when the body is read
        return line.split(separator)


def _separator(first: str, lines: list[str]) -> str | None:
    """The mark that most lines below the first one have; None is white space."""
    for mark in (";", "\t", ","):
        having = [line for line in lines if mark in line.strip()]
        if len(having) * 2 < len(lines) or not having:
            continue
        last = having[-1]
        # A tab or blank before padded numbers is white space, not an empty cell, unless the first row has a name there.
        named = not first[:1].isspace() and first.count(mark) == last.count(mark)
        blank = mark == "\t" and "\t\t" not in last and last.rstrip("\t") != last.strip() and not named
        # 1,5 2,5 has commas as decimal marks.
        words = mark == "," and all(_comma_numbers(line) for line in having)
        return None if blank or words else mark
    return None


def _comma_numbers(line: str) -> bool:
    words = line.split()
    return len(words) > 1 and all(is_number(word.replace(",", ".")) for word in words)


def _is_header(first: Sequence[str], second_row: Sequence[str]) -> bool:
    """Whether the first row holds names: it has text, and the row below does not have text in the same places."""
    texts = [j for j, cell in enumerate(first) if cell and not _is_cell_of_numbers(cell)]
    if not texts:
        return False
    if any(_is_cell_of_numbers(cell) and not cell.isdigit() for cell in first):
        return False  # 0.5 is no name: the row is one of numbers, with a text in it
    if any(cell.isdigit() for cell in first):
        return any(j < len(second_row) and _is_cell_of_numbers(second_row[j]) for j in texts)
    return True


def _is_count(first: Sequence[str]) -> bool:
    """Whether a row is 0, 1, 2, ... or 1, 2, 3, ..., as programs name the columns of a matrix."""
    return len(first) > 1 and any(list(first) == [str(j + k) for j in range(len(first))] for k in (0, 1))


def _is_cell_of_numbers(cell: str) -> bool:
    return is_number(cell) or re.match(WITH_COMMA, cell) is not None


def _units_of_row(row: Sequence[str]) -> list[str]:
    """The units of a row that holds nothing else, "" for a cell without one; empty for another row."""
    texts = [cell.strip("[](){} ") for cell in row]
    units = [text if is_unit(text) else "" for text in texts]
    blanks = [text in ("", "-", "1", "–") and not is_number(cell) for text, cell in zip(texts, row, strict=True)]
    return units if any(units) and all(map(any, zip(units, blanks, strict=True))) else []


def _names_in_comment(path: Path, layout: Layout) -> list[str] | None:
    """Names in the last comment above a table without a header, if it has a word for each column."""
    lines_above = [text for text in comments(path) if not text.startswith(HEADER)]
    names = _split(lines_above[-1], layout.separator) if lines_above else []
    named = len(names) == layout.width and len(set(names)) == len(names)
    return names if named and all(re.match(r"[^\W\d]", name) for name in names) else None


def _numbered(names: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The names, each that comes again with its number in front of its unit, and what the header calls those."""
    distinct, again = list[str](), dict[str, str]()
    for name in names:
        own, number = name, 1
        while own in distinct or (own in names and number > 1):
            number += 1
            place = UNIT_MARK.search(name, 1)
            assert place is not None
            own = f"{name[: place.start()]} {number}{place[0]}"
        distinct.append(own)
        again |= {own: name} if number > 1 else {}
    return distinct, again


def _settle_repeated(columns: dict[str, Sequence[str] | np.ndarray], again: Mapping[str, str]) -> list[str]:
    """Takes away columns that hold the same as the one of their name before; a note on each that the header repeats."""
    notes = []
    for own, name in again.items():
        if _same(columns[own], columns[name]):
            del columns[own]
            notes.append(f"two columns are called {name!r} and hold the same: one is read")
        else:
            notes.append(f"two columns are called {name!r}: the later one is {own!r} here")
    return notes


def _same(cells: Sequence[str] | np.ndarray, others: Sequence[str] | np.ndarray) -> bool:
    if isinstance(cells, np.ndarray) and isinstance(others, np.ndarray):
        return np.array_equal(cells, others, equal_nan=True)
    return list(cells) == list(others)

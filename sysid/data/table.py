"""Table: the columns of a file as they were read; a column becomes numbers only when it is used, and a cell
that is none is explained.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import tables
from sysid.base.errors import InputError, unknown

if TYPE_CHECKING:
    import polars

THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([,.'\u2019 \u00a0\u202f])\d{3})(?:\1\d{3})*(?:(?!\1)[.,]\d*)?")
FORTRAN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)[dD][+-]?\d+")
UNITS = "[mkuµμ]?V|[muµμ]?A|°|º|deg|Grad|m?rad|%|[mnuµμ]?s|sec|rpm|1/min|[mc]?Nm?|[cmk]?m|Hz|kHz|counts?|ticks?"
WITH_UNIT = re.compile(rf"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?\s*({UNITS})")
NUMBER_LETTERS = re.compile(r"(?!\d{1,2}\.\d{1,2}\.\d{2}(?:\d{2})?$)[+-]?[.,]?\d[\d.,]{0,40}")  # no date: 14.03.2026
HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]+|(?=.*\d)[0-9a-fA-F]{2,16}[hH]?|[0-9A-F]{2,16}[hH]?")
FIRST, STRAY = 1000, 0.1  # cells that are looked at, and the share of words among them that are not there by mistake
# In small letters:
SPREADSHEET_ERRORS = ("#n/a", "#div/0!", "#value!", "#ref!", "#name?", "#num!", "#null!")
SWITCH_WORDS = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0}
LONGEST_CELL = 40  # letters of a cell that is looked at, and shown
CHUNK = 1 << 16  # cells that are Python strings at a time
LARGEST = 1e100  # squares of it still fit a float64, sums of squares of a million of them too


def explain_non_number(cell: str, column: str, decimal: str = ".", cells: Sequence[str] | np.ndarray = ()) -> str:
    """What stands in a cell of `column`, which holds the `cells`, that is no number, and what to do."""
    text, short = cell.strip(), cell if len(cell) <= LONGEST_CELL else cell[: LONGEST_CELL - 3] + "..."
    words = f"found {short!r}"
    if text == column.strip():
        return (
            f"{words}, the header again: where two logs stand in one file, split it there into two (qpal identify "
            "takes several); where the time goes on, remove the row"
        )
    if text.lower() in SPREADSHEET_ERRORS:
        return f"{words}, an error of a spreadsheet; empty the cell, which is then a missing value"
    if len(text) <= LONGEST_CELL and (unit := WITH_UNIT.fullmatch(text)):
        return f"{words}, a number with its unit; write numbers alone: {unit[1]!r} belongs into the header"
    if is_hexadecimal(text) and _share_of_words(cells) > STRAY:
        also = f"; if it is Fortran's, write {text.upper().replace('D', 'e')}" if FORTRAN.fullmatch(text) else ""
        return (
            f"{words}, which seems to be a hexadecimal word: set base = 16 for its channel in a mapping (qpal info "
            f"FILE --write-map MAP.toml writes one){also}"
        )
    correction = _correct_spelling(text, decimal) if is_number_otherwise_spelled(text) else ""
    return f"{words}, which is not a number; correct the cell{correction}"


def _correct_spelling(text: str, decimal: str) -> str:
    """How a number is written that other programs spell with thousands marks or with the exponent of Fortran."""
    if FORTRAN.fullmatch(text):
        return f": write {text.upper().replace('D', 'e')}"
    match = THOUSANDS.fullmatch(text)
    assert match is not None
    number = text.replace(match[1], "").replace(",", ".").rstrip(".").replace(".", decimal)
    return f": write numbers without thousands marks, {number} if that is meant"


def is_like_a_number(text: str) -> bool:
    """Whether a text that is no number was meant as one: it is spelled as one, or has the letters of one."""
    text = text.strip()
    letters = NUMBER_LETTERS.fullmatch(text) is not None
    return letters or is_number_otherwise_spelled(text) or (text[:2] in ("0x", "0X") and is_hexadecimal(text))


def is_number_otherwise_spelled(text: str) -> bool:
    """Whether a text that is no number stands for one beyond doubt: with thousands marks, a unit, or as in Fortran."""
    text = text.strip()
    return len(text) <= LONGEST_CELL and any(form.fullmatch(text) for form in (FORTRAN, THOUSANDS, WITH_UNIT))


def _share_of_words(cells: Sequence[str] | np.ndarray) -> float:
    """The share of hexadecimal words that are no decimal numbers among the first cells."""
    first = [str(cell) for cell in cells[:FIRST]]
    return sum(is_hexadecimal(cell) and not is_number(cell) for cell in first) / max(len(first), 1)


def is_hexadecimal(text: str) -> bool:
    """Whether a text that is no number may be a word in hexadecimal, as no word of a language is."""
    return HEXADECIMAL.fullmatch(text.strip()) is not None


class Texts(Sequence[str]):
    """Texts (n,) that polars holds; each is made a Python string when it is asked for."""

    def __init__(self, series: "polars.Series") -> None:
        self._series = series

    def __len__(self) -> int:
        return len(self._series)

    def __getitem__(self, k: Any) -> Any:
        return self._series[k].to_list() if isinstance(k, slice) else self._series[int(k)]

    def __iter__(self) -> Iterator[str]:
        for start in range(0, len(self), CHUNK):
            yield from self._series[start : start + CHUNK].to_list()

    def taken(self, rows: np.ndarray) -> "Texts":
        """The texts of some rows (m,)."""
        return Texts(self._series.gather(rows))

    def equal(self, text: str) -> np.ndarray:
        """Which cells (n,) are this text."""
        return (self._series == text).to_numpy()

    def numbers(self, decimal: str = ".") -> np.ndarray:
        """The cells (n,) as float64 as Python reads them; nan for one that is no number."""
        import polars

        tables.check_fork()
        texts = self._series
        if decimal == ",":
            texts = texts.str.replace_all(",", ".", literal=True)
        texts = texts.str.strip_chars()
        values = texts.cast(polars.Float64, strict=False)
        odd = values.is_null()
        found = values.to_numpy(writable=True)
        if odd.any():  # empty, no number, or one that Python alone reads, such as digits of other alphabets
            others = {text: number for text in texts.filter(odd).unique() if (number := _float_of(text)) is not None}
            if others:
                places = np.flatnonzero(odd.to_numpy())
                found[places] = [others.get(texts[int(k)], np.nan) for k in places]
        return found


def is_number(text: str) -> bool:
    """Whether a cell is a number (nan and inf count, although they are not usable)."""
    return _float_of(text) is not None


def _float_of(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


@dataclass(frozen=True)
class Table:
    """Columns of one file.

    `columns[j]` holds the cells of `names[j]`: strings (n,) of a text file, numbers (n,) of a binary one. `rows[j]`
    holds the numbers of those cells in the file, for messages; `place` is the file's word for such a number. A text
    file that has no header gets the names 1, 2, ...

    `units` has the unit of a column as the file writes it, without the columns that name none. `meta` is what the
    writer said of the whole record. `notes` are sentences about what the reader repaired or left out, with counts.
    `comments` are the lines above a table of text, without their marks. `dates` says of a column of dates how it became
    seconds; `undated` why one was not read: it stayed text. `timed` are the columns whose type in the file is a time:
    they are in seconds whatever their names say. `local` are columns of dates and times of day without an offset from
    UTC, with the seconds since 1970 at which they are 0, nan for a time of day. `clocks` names the column of the time
    stamps of each column, where these have clocks of their own, which count from one origin. `joined` are the clocks
    that were made of two columns, with their names. `hexadecimal` are the columns whose words became numbers.
    """

    path: Path
    names: tuple[str, ...]
    columns: tuple[Sequence[str] | np.ndarray, ...]
    rows: tuple[Sequence[int], ...]
    place: str = "row"
    decimal: str = "."
    units: Mapping[str, str] = field(default_factory=dict)
    meta: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    comments: tuple[str, ...] = ()
    dates: Mapping[str, str] = field(default_factory=dict)
    undated: Mapping[str, str] = field(default_factory=dict)
    timed: frozenset[str] = frozenset()
    local: Mapping[str, float] = field(default_factory=dict)
    clocks: Mapping[str, str] = field(default_factory=dict)
    joined: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    hexadecimal: frozenset[str] = frozenset()

    def length(self, name: str) -> int:
        """Number of cells of a column."""
        return len(self.columns[self.names.index(name)])

    def places(self, count: int) -> str:
        """The file's word for the numbers of so many cells."""
        return self.place if count == 1 else "entries" if self.place == "entry" else f"{self.place}s"

    def numbers(self, name: str) -> np.ndarray:
        """Column `name` (n,) as float64; raises InputError that names the first cell that is not finite."""
        if name not in self.names:
            error = unknown("column", name, self.names)
            raise InputError(f"{self.path}: {error}")
        if name in self.undated:
            raise InputError(f"{self.path}: {self.undated[name]}")
        j = self.names.index(name)
        cells = self.columns[j]
        values = self._from_text(j) if len(cells) and isinstance(cells[0], str) else np.array(cells, dtype=float)
        for bad, found, remedy in (
            (np.isnan(values), "no value (NaN)", "remove or fill it"),
            (np.isinf(values), "an infinite value", "remove or correct it"),
            (np.abs(values) > LARGEST, "a value above 1e100", "give the column in a sensible unit"),
        ):
            if bad.any():
                k = int(np.argmax(bad))
                count = int(bad.sum())
                more = f" (and {count - 1} more like it)" if count > 1 else ""
                raise self.error(j, k, f"found {found}{more}; {remedy}")
        return values

    def error(self, column: int | str, k: int, sentence: str) -> InputError:
        """The error for cell k of a column, by its place or its name: file, row, column, sentence."""
        j = self.names.index(column) if isinstance(column, str) else column
        return InputError(f"{self.path}, {self.place} {self.rows[j][k]}, column {self.names[j]!r}: {sentence}")

    def _from_text(self, j: int) -> np.ndarray:
        column = self.columns[j]
        if isinstance(column, Texts):
            values = column.numbers(self.decimal)
            for k in map(int, np.flatnonzero(np.isnan(values))):
                self._check_cell(j, k, column[k].replace(",", ".") if self.decimal == "," else column[k])
            return values
        cells = [cell.replace(",", ".") for cell in column] if self.decimal == "," else list(column)
        try:
            # Python reads 1_000 as a number; in a log it is an error.
            if any("_" in cell for cell in cells):
                raise ValueError
            return np.array([float(cell) for cell in cells])
        except ValueError:
            for k, cell in enumerate(cells):
                self._check_cell(j, k, cell)
            raise

    def _check_cell(self, j: int, k: int, cell: str) -> None:
        """Raises InputError for a cell that is no number."""
        if not cell.strip():
            raise self.error(j, k, "found an empty cell; remove the row or fill it") from None
        if not is_number(cell):
            shown = self.columns[j][k]  # as the file has it
            raise self.error(j, k, explain_non_number(shown, self.names[j], self.decimal, self.columns[j])) from None

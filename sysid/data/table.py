"""Table: the columns of a file as they were read; a column becomes numbers only when it is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.data.spelling import why_no_number
from sysid.data.texts import Texts, is_number

LARGEST = 1e100  # squares of it still fit a float64, sums of squares of a million of them too


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
    UTC, with the seconds since 1970 at which they are 0, nan for a time of day.
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
            raise self.error(j, k, why_no_number(shown, self.names[j], self.decimal)) from None


__all__ = ["LARGEST", "Table", "Texts", "is_number"]

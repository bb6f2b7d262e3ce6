"""Named arrays of a file as the columns of a table: which of them are signals, and what becomes of the others."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._unit_names import units_of

WHOLE = 2**53  # whole numbers up to here are exact in float64
NUMERIC = "biuf"
TIMES = "mM"


class Arrays:
    """Gathers arrays by name, then makes the table.

    A numeric vector is a column; column j (from 1) of a matrix M is called M:j, where the longer side of the matrix are
    the samples; a field f of a record r is called r.f. Single numbers and texts become `meta`. Times become seconds,
    since the first of all in the file where they are dates. The rest is left out and noted.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.columns: dict[str, np.ndarray] = {}
        self.units: dict[str, str] = {}
        self.meta: dict[str, Any] = {}
        self.notes: list[str] = []
        self.clocks: dict[str, str] = {}
        self._dates: list[str] = []
        self._timed: list[str] = []
        self._local: dict[str, float] = {}
        self._left: list[str] = []

    def add(self, name: str, values: Any) -> None:
        """Takes one array, whatever it is."""
        values = np.asarray(values)
        if values.dtype.names:
            for part in values.dtype.names:
                self.add(f"{name}.{part}", values[part])
        elif values.size == 1 and values.dtype.kind in NUMERIC + "U":
            self.meta[name] = values.ravel()[0].item()
        elif values.dtype.kind not in NUMERIC + TIMES or values.size == 0 or squeeze(values).ndim > 2:
            self.leave_out(name, describe_array(values))
        elif squeeze(values).ndim == 2:
            values = squeeze(values)
            samples = values if values.shape[0] >= values.shape[1] else values.T
            for j in range(samples.shape[1]):
                self.column(f"{name}:{j + 1}", samples[:, j])
        else:
            self.column(name, values.ravel())

    def leave_out(self, name: str, description: str) -> None:
        """Notes that `name` is no signal."""
        self._left.append(f"{name} ({description})")

    def column(self, name: str, values: np.ndarray, local: bool | None = None) -> None:
        """Takes one signal (n,): numbers, booleans, dates or spans of time.

        `local` is whether times have no offset from UTC, by default whether they are dates: NumPy's name none.
        """
        if name in self.columns:
            raise InputError(f"{self.path}: two columns are called {name!r}; rename one of them")
        if values.dtype.kind in TIMES:
            self._timed.append(name)
            if local if local is not None else values.dtype.kind == "M":
                self._local[name] = np.nan
        if values.dtype.kind == "M":
            self._dates.append(name)
            self.columns[name] = values
        elif values.dtype.kind == "m":
            self.columns[name] = seconds(values)
            self.units[name] = "s"
        else:
            long = values.dtype.kind in "iu" and values.itemsize == 8
            if long and max(abs(int(values.min())), abs(int(values.max()))) > WHOLE:
                self.notes.append(f"rounded {name!r} to 16 digits, as it holds whole numbers above 2^53")
            self.columns[name] = values.astype(float, copy=False)

    def table(self, place: str, message: str) -> Table:
        """The table; raises InputError with the sentence `message` if no array was a signal."""
        self._add_dates()
        if self._left and self.columns:
            self.notes.append(f"left out what is no signal: {', '.join(self._left)}")
        if not self.columns:
            raise InputError(f"{self.path} {message}")
        rows = tuple(range(1, len(values) + 1) for values in self.columns.values())
        return Table(
            self.path,
            tuple(self.columns),
            tuple(self.columns.values()),
            rows,
            place=place,
            units=self._units(),
            meta=self.meta,
            notes=tuple(self.notes),
            timed=frozenset(self._timed),
            local=self._local,
            clocks=self.clocks,
        )

    def _units(self) -> dict[str, str]:
        """Units in the names, those of a matrix M for all M:j, and of times."""
        matrices = {name: re.sub(r":\d+$", "", name) for name in self.columns}
        units = units_of(dict.fromkeys(matrices.values()))
        return {name: units[matrices[name]] for name in matrices if matrices[name] in units} | self.units

    def _add_dates(self) -> None:
        """Puts seconds since the first date of the file in place of dates."""
        if not self._dates:
            return
        times = [self.columns[name][~np.isnat(self.columns[name])] for name in self._dates]
        first = min((values.min() for values in times if len(values)), default=np.datetime64(0, "ns"))
        for name in self._dates:
            self.columns[name] = seconds(self.columns[name] - first)
            self.units[name] = "s"
            if name in self._local:
                self._local[name] = float((first - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
        self.notes.append(f"read {', '.join(map(repr, self._dates))} as seconds since {first}")
        self.meta.setdefault("start", str(first))


def squeeze(values: np.ndarray) -> np.ndarray:
    """The array without its sides of length 1."""
    return values.reshape([n for n in values.shape if n != 1])


def seconds(spans: np.ndarray) -> np.ndarray:
    """Spans of time as float64 [s]; NaN where there is none."""
    fine = spans.astype("timedelta64[ns]")
    return np.where(np.isnat(fine), np.nan, fine.astype(np.int64) / 1e9)


def describe_array(values: np.ndarray) -> str:
    """Kind and shape of an array, for messages."""
    kind = {"c": "complex", "O": "objects", "V": "struct", "U": "text", "S": "text", "M": "dates", "m": "times"}
    return f"{kind.get(values.dtype.kind, 'numeric')} {'x'.join(map(str, values.shape)) or '1'}"


def list_descriptions(descriptions: Mapping[str, str]) -> str:
    """Names with what they are, for messages."""
    return ", ".join(f"{name} ({description})" for name, description in descriptions.items()) or "nothing"

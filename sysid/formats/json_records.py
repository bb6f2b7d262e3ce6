"""JSON: a list of samples, columns as lists, or such lists among what else was said of the record; and JSON lines."""

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._format import Format
from sysid.formats._long_table import KEYS
from sysid.formats._unit_names import units_of

STAMPS = {"t", "time", "times", "timestamp", "timestamps", "stamp", "stamps", "ts", "x"}  # beside one signal's values
LINES = object()  # stands for a file that holds one value a line


class JsonRecords(Format):
    """Reads .json and .jsonl (one sample a line).

    Samples are objects, one column a key: a nested key is called a.b, element k (from 0) of a list a[k]. An object may
    hold lists of numbers, which are columns, or lists of samples, whose columns are called list.key unless there is but
    one list. A list of signals, each with its name, its values and, where it has any, its stamps, gives the columns of
    each. All else in it is `meta`. true and false are 1 and 0; null is no value.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".json", ".jsonl", ".ndjson")
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """The columns of `path`; raises InputError if it is no JSON or holds no samples."""
        try:
            columns = _Columns(path)
            value = _value(path) if path.suffix.lower() == ".json" else LINES
            if value is LINES:
                columns.take_lines(_lines(path, columns.notes))
            else:
                columns.take(value)
            return columns.table()
        except RecursionError:
            raise InputError(
                f"{path} is not a readable JSON file (nested too deep); save it as a list of samples"
            ) from None


class _Columns:
    """Columns found so far: cells by name, and the numbers of their entries or rows."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.place = "entry"
        self.columns: dict[str, list[Any]] = {}
        self.rows: dict[str, Sequence[int]] = {}
        self.meta: dict[str, Any] = {}
        self.notes: list[str] = []

    def take(self, value: Any) -> None:
        """A whole file's value."""
        if isinstance(value, list):
            self._list("", value, range(1, len(value) + 1))
        elif isinstance(value, dict):
            self._object("", value, self.meta)
        else:
            raise InputError(f"{self.path} holds {_short(value)} and no samples; give a list of samples or columns")

    def take_lines(self, lines: list[tuple[int, Any]]) -> None:
        """The values of the lines of a file, with their row numbers; a first one unlike the others is `meta`."""
        self.place = "row"
        if len(lines) > 1 and all(isinstance(value, dict) for _, value in lines[:2]):
            first, second = (value for _, value in lines[:2])
            if not set(first) & set(second):
                self.meta |= first
                lines = lines[1:]
        self._list("", [value for _, value in lines], [row for row, _ in lines])

    def _object(self, prefix: str, value: dict[str, Any], meta: dict[str, Any]) -> None:
        """Takes an object: its lists are columns or samples, all else goes into `meta`."""
        names: list[Any] = value.get("columns") or []
        data: list[Any] = value.get("data") or []
        if _all(names, str) and _all(data, list) and all(len(row) == len(names) for row in data):  # as pandas splits it
            samples = [dict(zip(names, row, strict=True)) for row in data]
            self._list(prefix, samples, range(1, len(samples) + 1))
            return
        value = {key: _as_list(element) for key, element in value.items()}
        lists = [key for key, element in value.items() if isinstance(element, list) and _is_signal(element)]
        for key, element in value.items():
            if key in lists:
                alone = len(lists) == 1 and isinstance(element[0], dict)
                self._list(prefix if alone else _join(prefix, key), element, range(1, len(element) + 1))
            elif isinstance(element, dict):
                members: dict[str, Any] = {}
                self._object(_join(prefix, key), element, members)
                if members or not element:
                    meta[key] = members
            else:
                meta[key] = element

    def _list(self, prefix: str, entries: list[Any], rows: Sequence[int]) -> None:
        """Takes a list of samples: numbers, lists of one length, or objects of one form."""
        if not entries:
            raise InputError(f"{self.path} has no samples; give a list of at least one")
        kind = _kind(entries[0])
        for row, entry in zip(rows, entries, strict=True):
            if _kind(entry) != kind and entry is not None and entries[0] is not None:
                raise InputError(
                    f"{self.path}, {self.place} {row}: found {_short(entry)} where {self.place} {rows[0]} has "
                    f"{_short(entries[0])}; give every sample the same form"
                )
        if kind == "number":
            self._column(prefix or "1", entries, rows)
            return
        if kind == "list":
            entries, rows = self._rows_of(entries, rows), rows
            if len(entries) != len(rows):
                rows = range(1, len(entries) + 1)
            samples = [
                {f"{prefix}:{j + 1}" if prefix else str(j + 1): cell for j, cell in enumerate(e)} for e in entries
            ]
        elif signals := _signals_by_name(entries):
            self._object(prefix, signals, self.meta)
            return
        elif all(map(_is_experiment, entries)) and len(entries) < min(map(_length, entries)):
            for k, entry in enumerate(entries, start=1):
                name = f"{prefix or 'experiment'}({k})"
                self._object(name, entry, self.meta.setdefault(name, {}))
            return
        else:
            samples = [dict(_flat(prefix, entry or {})) for entry in entries]
            self._check_forms(samples, rows)
        for name in dict.fromkeys(name for sample in samples for name in sample):
            self._column(name, [sample.get(name) for sample in samples], rows)

    def _check_forms(self, samples: list[dict[str, Any]], rows: Sequence[int]) -> None:
        """Raises InputError for an entry that is a number in one sample and a list or an object in another."""
        names = {name for sample in samples for name in sample}
        parents = {name: parent for name in names for parent in _parents(name) if parent in names}
        for row, sample in zip(rows, samples, strict=True):
            for name in sample if parents else ():
                if parents.get(name, name) not in sample:
                    raise InputError(
                        f"{self.path}, {self.place} {row}: found a list or an object for {parents[name]!r}, which is a "
                        "number elsewhere; give every sample the same form"
                    )

    def _rows_of(self, entries: list[list[Any]], rows: Sequence[int]) -> list[list[Any]]:
        """A matrix by samples, along its longer side."""
        for row, entry in zip(rows, entries, strict=True):
            if entry is None:
                raise InputError(
                    f"{self.path}, {self.place} {row}: found null where {self.place} {rows[0]} has a list; give every "
                    "sample the same number of values, each null where it is missing"
                )
            if len(entry) != len(entries[0]):
                raise InputError(
                    f"{self.path}, {self.place} {row}: found {len(entry)} values where {self.place} {rows[0]} has "
                    f"{len(entries[0])}; give every sample the same number of values"
                )
        return entries if len(entries) >= len(entries[0]) else [list(row) for row in zip(*entries, strict=True)]

    def _column(self, name: str, cells: list[Any], rows: Sequence[int]) -> None:
        if any(isinstance(cell, dict | list) for cell in cells):
            self.notes.append(f"left out {name!r}, which has no numbers but lists or objects")
            return
        if name in self.columns:
            raise InputError(f"{self.path}: two columns are called {name!r}; rename one of them")
        self.columns[name], self.rows[name] = cells, rows

    def table(self) -> Table:
        """The table; raises InputError if no column has a number."""
        columns = {name: _cells(cells) for name, cells in self.columns.items()}
        if not any(isinstance(cells, np.ndarray) or any(map(_numeric, cells)) for cells in columns.values()):
            names = ", ".join([*self.columns, *self.meta]) or "nothing"
            raise InputError(f"{self.path} has no samples with numbers; found {names[:200]}; give a list of samples")
        return Table(
            self.path,
            tuple(columns),
            tuple(columns.values()),
            tuple(self.rows.values()),
            place=self.place,
            units=units_of(columns),
            meta=self.meta,
            notes=tuple(self.notes),
        )


def _value(path: Path) -> Any:
    """The value of a file, `LINES` if it is one value a line."""
    raw = path.read_bytes()
    try:
        return json.loads(raw, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        if error.msg == "Extra data" and error.lineno > 1:
            return LINES
        raise _broken_error(path, error, error.lineno) from None
    except _TwiceError as error:
        raise InputError(f"{path}: two entries of one object are called {error.name!r}; rename one of them") from None
    except ValueError as error:
        raise _broken_error(path, error) from None


def _lines(path: Path, notes: list[str]) -> list[tuple[int, Any]]:
    """The values of the lines with their rows; a last line that was cut is left out and noted."""
    try:
        lines = path.read_bytes().decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise _broken_error(path, error) from None
    values = []
    for row, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            values.append((row, json.loads(line, object_pairs_hook=_unique)))
        except _TwiceError as error:
            raise InputError(f"{path}, row {row}: two entries are called {error.name!r}; rename one of them") from None
        except ValueError as error:
            if row < len(lines) or not values:
                raise _broken_error(path, error, row) from None
            notes.append(f"left out row {row}, the last, which is cut off")
    if not values:
        raise InputError(f"{path} has no samples; give a file with one a row")
    return values


def _broken_error(path: Path, error: ValueError, row: int | None = None) -> InputError:
    description = f"{error.msg} at character {error.colno}" if isinstance(error, json.JSONDecodeError) else str(error)
    if "int_max_str_digits" in description:  # Python's advice is for programmers
        description = "a whole number of more than 4300 digits"
    place = "" if row is None else f", row {row},"
    return InputError(f"{path}{place} is not a readable JSON file ({description}); it is cut or damaged; save it again")


class _TwiceError(Exception):
    """Two values of one name in one object, of which the json module would keep the last without a word."""

    def __init__(self, name: str) -> None:
        self.name = name


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        names = [name for name, _ in pairs]
        raise _TwiceError(next(name for name in names if names.count(name) > 1))
    return members


def _flat(prefix: str, entry: Any) -> Iterator[tuple[str, Any]]:
    """The cells of one sample by column."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            yield from _flat(_join(prefix, key), value)
    elif isinstance(entry, list):
        for k, value in enumerate(entry):
            yield from _flat(f"{prefix}[{k}]", value)
    else:
        yield prefix, entry


def _parents(name: str) -> Iterator[str]:
    """a and a.b of a.b[0]."""
    for k, letter in enumerate(name):
        if k and letter in ".[":
            yield name[:k]


def _join(prefix: str, key: str) -> str:
    return f"{prefix}.{key}" if prefix else key


def _as_list(value: Any) -> Any:
    """An object with the keys 0, 1, ... as the list that it is."""
    numbered = isinstance(value, dict) and len(value) > 1 and list(value) == [str(k) for k in range(len(value))]
    return list(value.values()) if numbered else value


def _is_signal(value: list[Any]) -> bool:
    return bool(value) and (isinstance(value[0], dict | list) or any(isinstance(e, int | float) for e in value))


def _is_experiment(entry: Any) -> bool:
    """Whether an entry of a list is no sample but a record: columns of one length, or a list of samples."""
    lists = [value for value in entry.values() if isinstance(value, list)] if isinstance(entry, dict) else []
    samples = len(lists) == 1 and _all(lists[0], dict)
    return samples or (len(lists) > 1 and len(set(map(len, lists))) == 1 and all(map(_is_signal, lists)))


def _signals_by_name(entries: list[Any]) -> dict[str, Any]:
    """The entries of a list by their names, where each is one signal: a list of values, alone or beside its stamps."""
    signals = {}
    for entry in entries if len(entries) > 1 and _all(entries, dict) else []:
        name = next((entry[key] for key in entry if key.lower() in KEYS and isinstance(entry[key], str)), "")
        lists = {key: value for key, value in entry.items() if isinstance(value, list) and len(value) > len(entries)}
        if not name or len([key for key in lists if key.lower() not in STAMPS]) != 1 or len(lists) > 2:
            return {}
        signals[name] = lists
    return signals if len(signals) == len(entries) else {}


def _length(entry: dict[str, Any]) -> int:
    return max(len(value) for value in entry.values() if isinstance(value, list))


def _all(value: Any, kind: type) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(element, kind) for element in value)


def _kind(value: Any) -> str:
    return "object" if isinstance(value, dict) else "list" if isinstance(value, list) else "number"


def _cells(cells: list[Any]) -> list[str] | np.ndarray:
    """A column as numbers, or as texts if one of its cells is a text."""
    if any(isinstance(cell, str) for cell in cells):
        return ["" if cell is None else cell if isinstance(cell, str) else json.dumps(cell) for cell in cells]
    return np.array([_float(cell) for cell in cells], dtype=float)


def _float(cell: float | None) -> float:
    try:
        return math.nan if cell is None else float(cell)
    except OverflowError:  # a whole number of more than 308 digits
        return math.inf if cell and cell > 0 else -math.inf


def _numeric(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list):
        return "a list"
    return json.dumps(value)[:40]

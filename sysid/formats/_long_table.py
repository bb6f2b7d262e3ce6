"""Long tables: one row for each value, with its time and the name of its signal, as data bases export them."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import SWITCH_WORDS, Table, is_number
from sysid.formats._stack import EXPERIMENT_WORDS, RUN_WORDS
from sysid.formats._unit_names import units_of

KEYS = {"key", "name", "topic", "signal", "channel", "variable", "field", "_field", "sensor", "series", "metric", "tag"}
KEYS |= {
    "entity",
    "point",
    "item",
    "id",
}  # entity_id of Home Assistant, whose history has entity_id, state, last_changed
_OF_KEY = re.compile("[ _.-]*(?:name|id)$")  # TagName, sensor_id
VALUES = {"payload", "value", "_value", "val", "values", "reading", "data", "wert", "valeur", "valor"}
UNITS = {"unit", "units", "einheit"}
MOST = 200  # names: more are texts of another kind
REPEATED = 2.0  # rows of a name on the average, at least
LARGEST = 1 << 28  # cells of the table that is made


def pivoted(table: Table) -> Table:
    """The table with a column for each name of a long one, in the order of time; others as they are.

    Columns are called as data bases call them, or there is one of words and one of numbers beside times that come
    again, so that no other table would have an input and an output. Rows of one time become one. Raises InputError
    where the table would be too large.
    """
    if len({len(cells) for cells in table.columns}) != 1 or not len(table.columns[0]):
        return table
    columns = {name.strip().lower(): j for j, name in enumerate(table.names)}
    keys, values, units = _columns(columns, KEYS), _value_column(columns), _column(columns, UNITS)
    keys = [j for j in keys if table.names[j].strip().lower() in KEYS or not _is_numeric(table.columns[j])]
    words = [j for j in range(len(table.names)) if j != units and _tells(table.columns[j])]
    moving = [j for j in range(len(table.names)) if _moves(table, j) and table.names[j] not in table.dates]
    signals = [j for j in moving if _turns(_floats(table, j))]  # the others are times, or numbers of series
    by_name = bool(keys) and values is not None
    keys = keys or (words if len(words) == 1 else [])
    values = signals[0] if values is None and len(signals) == 1 else values
    if not keys or values is None or values in keys:
        return table
    others = [j for j in range(len(table.names)) if j not in (*keys, values, units)]
    runs = [j for j in others if set(re.split("[^a-z]+", table.names[j].lower())) & (EXPERIMENT_WORDS | RUN_WORDS)][:1]
    times = [j for j in others if j not in runs and _moves(table, j)]
    dated = [j for j in times if table.names[j] in table.dates]  # beside numbers of series and of quality
    names = _names(table, keys)
    if dated and not runs and len({*zip(names, _floats(table, dated[0]), strict=True)}) < len(names):
        names = _names(table, [*keys, *(j for j in words if j in others)])  # of several machines
    distinct = list(dict.fromkeys(names))
    times = dated or [j for j in times if len(times) == 1 or _turns(_floats(table, j)) < len(distinct)]
    if not 2 <= len(distinct) <= min(MOST, len(names) / REPEATED) or len(times) != 1 or "" in distinct:
        return table
    if not by_name and len(np.unique(_floats(table, times[0]))) == len(names):
        return table  # words that say in each row what an output was beside, such as on and off
    group = np.unique(names, return_inverse=True)[1]
    group = np.array([distinct.index(name) for name in np.unique(names)])[group]
    order, row = _rows_of_runs(table, runs, _floats(table, times[0]), group)
    if (row[-1] + 1) * len(distinct) > LARGEST:
        raise InputError(
            f"{table.path}: a table of {len(names)} values of {len(distinct)} names would have {row[-1] + 1} rows, "
            "which is too large; give the rows of the names that are needed"
        )
    cells = _values(table, values)
    first = np.flatnonzero(np.diff(row, prepend=-1))  # the first value of each row
    time, rows = table.names[times[0]], np.asarray(table.rows[times[0]])[order][first]
    new: dict[str, Sequence[str] | np.ndarray] = {table.names[j]: _taken(table, j, order[first]) for j in runs}
    new[time] = _floats(table, times[0])[order][first]
    left_out = []
    for k, name in enumerate(distinct):
        mine = order[group[order] == k]
        if not np.isfinite(cells[mine]).any():
            left_out.append(name)
            continue
        column = np.full(row[-1] + 1, np.nan)
        column[row[group[order] == k]] = cells[mine]
        new[name if name not in new else f"{name} ({table.names[keys[0]]})"] = column
    notes = [f"a table of one value a row: each name in {table.names[keys[0]]!r} became a column ({', '.join(new)})"]
    notes += [f"left out {', '.join(left_out)}: no numbers"] if left_out else []
    return replace(
        table,
        names=tuple(new),
        columns=tuple(new.values()),
        rows=(rows,) * len(new),
        units=_units(table, names, units, time, distinct),
        decimal=".",
        notes=(*table.notes, *notes),
    )


def may_be_long(names: Sequence[str]) -> bool:
    """Whether the names of columns are those of a long table."""
    columns = {name.strip().lower(): j for j, name in enumerate(names)}
    return bool(_columns(columns, KEYS)) and _value_column(columns) is not None


def _tells(cells: Sequence[str] | np.ndarray) -> bool:
    """Whether the cells of a column are a few words, each in many rows."""
    return not _is_numeric(cells) and 2 <= len(set(cells)) <= min(MOST, len(cells) / REPEATED)


def _moves(table: Table, j: int) -> bool:
    """Whether a column of numbers changes."""
    if not _is_numeric(table.columns[j]):
        return False
    x = _floats(table, j)
    return bool(np.any(x[1:] != x[:-1]))


def _names(table: Table, keys: Sequence[int]) -> list[str]:
    """The name (n,) of each value: the words of the columns `keys`, of those alone that tell further signals apart."""
    names, count = [""] * len(table.columns[keys[0]]), 1
    for j in keys:
        texts = [str(text).strip() for text in _texts(table.columns[j])]
        longer = [f"{name}.{text}" if name else text for name, text in zip(names, texts, strict=True)]
        if len(set(longer)) > count or len(keys) == 1:
            names, count = longer, len(set(longer))
    return names


def _rows_of_runs(table: Table, runs: Sequence[int], t: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same as `_rows`, run by run where a column tells these apart."""
    if not runs:
        return _rows(t, group)
    number = np.unique(np.asarray(_texts(table.columns[runs[0]])), return_inverse=True)[1]
    orders, rows, count = [], [], 0
    for run in dict.fromkeys(number.tolist()):
        mine = np.flatnonzero(number == run)
        order, row = _rows(t[mine], group[mine])
        orders.append(mine[order])
        rows.append(row + count)
        count += int(row[-1]) + 1
    return np.concatenate(orders), np.concatenate(rows)


def _taken(table: Table, j: int, chosen: np.ndarray) -> Sequence[str] | np.ndarray:
    cells = table.columns[j]
    return _floats(table, j)[chosen] if _is_numeric(cells) else [str(cells[k]) for k in chosen.tolist()]


def _rows(t: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The values (n,) in the order of rows, and the row of each: values that stand together and have one time.

    Where the values of a name stand in one block they are put in the order of time first.
    """
    order = np.arange(len(t))
    blocks = int(np.count_nonzero(np.diff(group))) + 1
    if blocks == len(np.unique(group)) and np.all(np.isfinite(t)):
        order = np.argsort(t, kind="stable")
    row, last, seen = np.zeros(len(t), dtype=int), -1, set[int]()
    at = np.nan
    for k, (time, name) in enumerate(zip(t[order].tolist(), group[order].tolist(), strict=True)):
        if time != at or name in seen:
            last, at, seen = last + 1, time, set()
        seen.add(name)
        row[k] = last
    return order, row


def _values(table: Table, j: int) -> np.ndarray:
    """The values (n,) as numbers: true is 1, and nan stands for a text."""
    cells = table.columns[j]
    if _is_numeric(cells):
        return np.asarray(cells, dtype=float)
    texts = (str(cell).strip().replace(",", ".") if table.decimal == "," else str(cell).strip() for cell in cells)
    return np.array([SWITCH_WORDS.get(text.lower(), float(text) if is_number(text) else np.nan) for text in texts])


def _turns(t: np.ndarray) -> int:
    """How often stamps go against their own direction: once behind each block of a name, if at all."""
    return int(min(np.count_nonzero(t[1:] < t[:-1]), np.count_nonzero(t[1:] > t[:-1])))


def _units(table: Table, names: Sequence[str], j: int | None, time: str, distinct: Sequence[str]) -> dict[str, str]:
    """The units in the names, and those of a column of units that does not change within a name."""
    units = units_of(distinct) | {name: unit for name, unit in table.units.items() if name == time}
    if j is not None:
        pairs = {(name, str(unit).strip()) for name, unit in zip(names, _texts(table.columns[j]), strict=True)}
        units |= {name: unit for name, unit in pairs if unit and sum(name == each for each, _ in pairs) == 1}
    return units


def _column(columns: dict[str, int], names: set[str]) -> int | None:
    places = _columns(columns, names)
    return places[0] if len(places) == 1 else None


def _value_column(columns: dict[str, int]) -> int | None:
    return _column(columns, VALUES) if _columns(columns, VALUES) else columns.get("state")


def _columns(columns: dict[str, int], names: set[str]) -> list[int]:
    """Columns of these names; of a nested one its last part says what it is."""
    return [j for name, j in columns.items() if not names.isdisjoint(_spellings(name))]


def _spellings(name: str) -> tuple[str, str]:
    last = name.rpartition(".")[2]
    return last, _OF_KEY.sub("", last)


def _texts(cells: Sequence[str] | np.ndarray) -> list[str]:
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
        return [f"{cell:g}" for cell in cells.tolist()]
    return list(cells)


def _is_numeric(cells: object) -> bool:
    return isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf"


def _floats(table: Table, j: int) -> np.ndarray:
    return np.asarray(table.columns[j], dtype=float)

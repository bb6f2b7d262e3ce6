"""A date in one column and the time of day in another one: the days that pass count, also where no midnight is seen."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sysid.data.table import Table
from sysid.formats._date_cells import DAY, FORMS, ORDERS
from sysid.formats._dates import WRITE, all_parts

_DATE = re.compile(
    r"([0-9]{4}[-/.][0-9]{1,2}[-/.][0-9]{1,2}|[0-9]{1,2}([-/.])[0-9]{1,2}\2(?:[0-9]{4}|[0-9]{2}))"
    r"(?:[T ]00:00(?::00(?:\.0*)?)?)?"
)
_DIGITS = re.compile(r"((?:19|20)[0-9]{2})([0-9]{2})([0-9]{2})")  # 20260310, in a column that is called a date
_NAMES = re.compile(r".*(?:date|datum|fecha|day|tag)", re.IGNORECASE)


def with_days(text: Table, table: Table) -> Table:
    """`table` with the days of a column of dates beside its times of day; `text` is the table before they were read.

    A date that stays, or changes where the time passes midnight, changes nothing. Where it says more, both are one
    clock; where it cannot be read so, the times are `undated` and say why.
    """
    times = [name for name in table.dates if _first(text, name) and re.match(FORMS["time"], _first(text, name))]
    if len(times) != 1:
        return table
    days = [name for name in text.names if name not in times and _is_date(name, _first(text, name))]
    if len(days) != 1:
        return table
    name, (i, j) = times[0], (text.names.index(each) for each in (days[0], times[0]))
    of = _days(_texts(text, days[0]))
    changes = np.flatnonzero([a != b for a, b in pairwise(of)]) + 1
    cells = _texts(text, name)
    if not len(changes) or len(of) != len(cells):
        return table
    own = np.asarray(table.columns[j], dtype=float)
    joined = [f"{day} {cell.strip()}" if cell.strip() else "" for day, cell in zip(of, cells, strict=True)]
    found = _readings(replace(text, columns=(*text.columns[:j], joined, *text.columns[j + 1 :])), j)
    if any(np.allclose(t, own, rtol=0.0, atol=1e-6, equal_nan=True) for t, _ in found):
        return table
    if not found and np.array_equal(changes, np.flatnonzero(np.diff(np.floor(_clock(own, cells) / DAY)) > 0) + 1):
        return table
    if len(found) == 1:
        t, begins = found[0]
        columns = tuple(t if k == j else of if k == i else each for k, each in enumerate(table.columns))
        said = f"columns {days[0]!r} and {name!r} were read together as seconds since {next(filter(None, joined))}"
        local = {**table.local, name: begins}
        dates = {key: each for key, each in table.dates.items() if key != days[0]}
        return replace(table, columns=columns, dates={**dates, name: said}, local=local)
    why = (
        f"column {name!r} holds times of day, and {days[0]!r} beside it changes in row {text.rows[j][int(changes[0])]} "
        f"in another way than they pass midnight; put both into one column: {WRITE}"
    )
    return replace(_without(table, text, name), undated={name: why, **table.undated})


def _without(table: Table, text: Table, name: str) -> Table:
    """The table in which a column is text again."""
    j = table.names.index(name)
    columns = (*table.columns[:j], text.columns[j], *table.columns[j + 1 :])
    left = {key: said for key, said in table.dates.items() if key != name}
    units = {key: unit for key, unit in table.units.items() if key != name or key not in table.dates}
    return replace(table, columns=columns, dates=left, units=units)


def _texts(table: Table, name: str) -> Sequence[str]:
    cells = table.columns[table.names.index(name)]
    if not isinstance(cells, np.ndarray):
        return cells
    whole = (
        cells.dtype.kind in "fiu" and len(cells) and bool(np.all((cells > 19e6) & (cells < 21e6) & (cells % 1 == 0)))
    )
    return [str(int(cell)) for cell in cells] if whole else []  # 20260310 was read as a number


def _first(table: Table, name: str) -> str:
    cells = _texts(table, name)
    if not len(cells) or not isinstance(cells[0], str):
        return ""
    return next((cell.strip() for cell in cells if cell.strip()), "")


def _is_date(name: str, first: str) -> bool:
    return bool(_DATE.fullmatch(first) or (_DIGITS.fullmatch(first) and _NAMES.fullmatch(name)))


def _days(cells: Sequence[str]) -> list[str]:
    """The date of each row, without a midnight behind it; an empty cell has the date above it."""
    said, last = [], ""
    known: dict[str, str] = {}
    for cell in cells:
        if cell not in known:
            text = cell.strip()
            date, digits = _DATE.fullmatch(text), _DIGITS.fullmatch(text)
            known[cell] = date[1] if date else "-".join(digits.groups()) if digits else text
        last = known[cell] or last
        said.append(last)
    return said


def _clock(since: np.ndarray, cells: Sequence[str]) -> np.ndarray:
    """Seconds (n,) since the first midnight."""
    hour, minute, second = (float(part) for part in re.findall(r"[0-9]+", next(c for c in cells if c.strip()))[:3])
    return since + 3600 * hour + 60 * minute + second


def _readings(table: Table, j: int) -> list[tuple[np.ndarray, float]]:
    """The different readings of column j: seconds (n,) since its first cell, and that cell since 1970 [s]."""
    first = next(filter(None, table.columns[j]), "")
    form = next((form for form, pattern in FORMS.items() if re.match(pattern, first)), None)
    if form is None:
        return []
    try:
        known, parts = all_parts(table, j, form)
    except ValueError:
        return []
    nanos = np.concatenate([each.nanos for each in parts])
    found: list[tuple[np.ndarray, float]] = []
    for order in ORDERS[form]:
        if any(each.wrong[order].any() for each in parts):
            continue
        seconds = np.concatenate([each.seconds[order] for each in parts])
        t = np.full(len(table.columns[j]), np.nan)
        t[known] = (seconds - seconds[0]).astype(float) + (nanos - nanos[0]) / 1e9
        if not any(np.array_equal(t, other, equal_nan=True) for other, _ in found):
            found.append((t, float(seconds[0] + nanos[0] / 1e9)))
    return found

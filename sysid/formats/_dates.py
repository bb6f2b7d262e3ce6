"""Columns of dates and times of day as seconds since their first cell, where that has one reading."""

import re
from dataclasses import replace

import numpy as np

from sysid.base import forked
from sysid.data.table import Table
from sysid.formats._date_cells import DAY, FORMS, ORDERS, Cells, taken_apart

LIKE = re.compile(r"\d{1,4}[./-]\d{1,2}[./-]\d{2,4}\b.*|.*\d:\d{2}\b.*|\d{4}-\d{2}-\d{2}.*|\d{8}T\d{4,6}.*")
CHUNK = 1 << 17  # cells that are taken apart at a time
WRITE = "write them as 2026-03-29T01:59:55.250 or as seconds, or give the sampling time with --ts"


class _NotReadError(ValueError):
    """Why a column that looks like dates is not read."""


def dated(table: Table) -> Table:
    """The table with seconds since the first cell in place of dates and times of day.

    `dates` says how a column was read; `undated` why one that looks like dates was not: it stays as it is.
    """
    columns, units = list(table.columns), dict(table.units)
    dates, undated, local = {}, {}, dict(table.local)
    for j, name in enumerate(table.names):
        cells = table.columns[j]
        if not len(cells) or not isinstance(cells[0], str):
            continue
        first = next((cell.strip() for cell in cells[:CHUNK] if cell.strip()), "")
        if not LIKE.fullmatch(first):
            continue
        try:
            columns[j], dates[name], begins = _read(table, j, first)
            local |= {name: begins} if begins is not None else {}
            units[name] = "s"
        except _NotReadError as error:
            undated[name] = f"column {name!r} holds dates or times such as {first[:40]!r}, {error}"
    if not dates and not undated:
        return table
    return replace(table, columns=tuple(columns), units=units, dates=dates, undated=undated, local=local)


def _read(table: Table, j: int, first: str) -> tuple[np.ndarray, str, float | None]:
    """Seconds (n,) since the `first` cell that is not empty, nan for empty ones, and how they were read.

    Then the seconds since 1970 of that cell in local time: nan for a time of day, and for a date with two readings;
    None for times in UTC, and for spans of time.
    """
    form = next((form for form, pattern in FORMS.items() if re.match(pattern, first)), None)
    if form is None:
        raise _NotReadError(f"in a form that is not read; {WRITE}")
    known, parts = all_parts(table, j, form)
    zoned = np.concatenate([each.zoned for each in parts])
    if zoned.any() and not zoned.all():
        row = table.rows[j][int(known[int(np.argmin(zoned == zoned[0]))])]
        raise _NotReadError(f"and row {row} differs from it in that only one of them has an offset from UTC; {WRITE}")
    nanos = np.concatenate([each.nanos for each in parts])
    orders = [order for order in ORDERS[form] if not any(each.wrong[order].any() for each in parts)]
    said, values = f"column {table.names[j]!r} was read as seconds since {first[:40]}", np.full(len(nanos), np.nan)
    for order in orders:
        seconds = np.concatenate([each.seconds[order] for each in parts])
        if form == "time" and max(each.longest for each in parts) < 24:
            seconds, midnights = _over_midnight(seconds, nanos)
            said += f"; midnight passed {'once' if midnights == 1 else f'{midnights} times'}" if midnights else ""
        t = (seconds - seconds[0]).astype(float) + (nanos - nanos[0]) / 1e9
        if order != orders[0] and not np.array_equal(t, values):
            raise _NotReadError(
                f"which may be {orders[0]} or {order}, and the date changes within the log; write the year first "
                "(2026-03-29), or give the sampling time with --ts"
            )
        values = t
    whole = np.full(len(table.columns[j]), np.nan)
    whole[known] = values
    if zoned.any() or (form == "time" and max(each.longest for each in parts) >= 24):
        return whole, said, None
    sure = form != "time" and len(orders) == 1
    return whole, said, float(parts[0].seconds[orders[0]][0] + nanos[0] / 1e9) if sure else np.nan


def all_parts(table: Table, j: int, form: str) -> tuple[np.ndarray, list[Cells]]:
    """The places (m,) of the cells that are not empty, and what these say."""
    import polars

    forked.check()
    cells, places, parts = table.columns[j], [], []
    for start in range(0, len(cells), CHUNK):
        texts = polars.Series([cell.strip() for cell in cells[start : start + CHUNK]], dtype=polars.String)
        filled = texts.str.len_bytes() > 0
        places.append(start + np.flatnonzero(filled.to_numpy()))
        part = taken_apart(texts.filter(filled), form)
        wrong = np.logical_and.reduce(list(part.wrong.values()))
        if wrong.any():
            k = int(places[-1][int(np.argmax(wrong))])
            raise _NotReadError(
                f"and row {table.rows[j][k]} has {cells[k].strip()[:40]!r}, which is none like it; correct the cell, "
                "or give the sampling time with --ts"
            )
        parts.append(part)
    known = np.concatenate(places)
    if not any(all(not part.wrong[order].any() for part in parts) for order in ORDERS[form]):
        raise _NotReadError(f"and no order of day and month makes dates of all cells; {WRITE}")
    return known, parts


def _over_midnight(seconds: np.ndarray, nanos: np.ndarray) -> tuple[np.ndarray, int]:
    """Times of day (n,) that go on after midnight, and how often it passed: a fall by more than half a day is one."""
    steps = np.diff(seconds) + np.diff(nanos) / 1e9
    turned = np.concatenate([[0], np.cumsum(steps < -0.5 * DAY)])
    return seconds + DAY * turned, int(turned[-1])

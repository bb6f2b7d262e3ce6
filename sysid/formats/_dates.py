"""Columns of dates and times of day as seconds since their first cell, where that has one reading.

A date in one column and the time of day in another one are read together: the days that pass count, also where no
midnight is seen.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import tables
from sysid.data.table import Table

if TYPE_CHECKING:
    import polars

# [0-9]: \d has the digits of other scripts too, of which polars makes no number.
_SECOND = r":(?P<second>[0-9]{2})(?:[.,](?P<part>[0-9]{1,18})|:(?P<milli>[0-9]{3}))?"
_TIMES = r"(?P<hour>[0-9]{{1,3}}):(?P<minute>[0-9]{{2}}){second}(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
_TIME = _TIMES.format(second=f"(?:{_SECOND})?")  # beside a date seconds may be left out; 12:05 alone may be 12 min 5 s
_ZONE = r"\s*(?P<zone>[Zz]|UTC|[+-][0-9]{2}(?::?[0-9]{2})?)?"
_YEAR, _ONE, _TWO = "(?P<year>[0-9]{4})", "(?P<one>[0-9]{1,2})", "(?P<two>[0-9]{1,2})"
FORMS = {
    "time": rf"^{_TIMES.format(second=_SECOND)}$",
    "year first": rf"^{_YEAR}[-/.]{_ONE}[-/.]{_TWO}(?:[Tt]|\s+){_TIME}{_ZONE}$",
    "dots": rf"^{_ONE}\.{_TWO}\.{_YEAR}(?:[Tt]|,?\s+){_TIME}{_ZONE}$",
    "year last": rf"^{_ONE}[/-]{_TWO}[/-]{_YEAR}(?:[Tt]|,?\s+){_TIME}{_ZONE}$",
}
ORDERS = {  # which of the two numbers beside the year is the month; nobody writes a month before a dot and the day
    "time": {"": ""},
    "year first": {"year-month-day": "one"},
    "dots": {"day.month.year": "two"},
    "year last": {"day/month/year": "two", "month/day/year": "one"},
}
DAY = 86400


@dataclass(frozen=True)
class Cells:
    """Cells (n,): seconds since 1970 or midnight by order, the nanoseconds beyond, which name an offset from UTC.

    `wrong` marks cells of another form, or without a date in an order; `longest` is the largest number of hours.
    """

    seconds: dict[str, np.ndarray]
    nanos: np.ndarray
    zoned: np.ndarray
    wrong: dict[str, np.ndarray]
    longest: int


def parse_cells(texts: "polars.Series", form: str) -> Cells:
    """What texts (n,) without blanks around them say in a form of `FORMS`."""
    import polars

    fields = texts.str.extract_groups(FORMS[form]).struct.unnest()

    def integers(name: str) -> np.ndarray:
        return fields[name].cast(polars.Int64).fill_null(0).to_numpy()

    hour, minute, second = integers("hour"), integers("minute"), integers("second")
    half = fields["half"].str.to_lowercase().fill_null("").to_numpy()
    halved = half != ""
    wrong = fields["hour"].is_null().to_numpy() | (minute > 59) | (second > 59)
    wrong |= halved & ((hour < 1) | (hour > 12))
    wrong |= (hour > 23) & (form != "time")
    hour = np.where(halved, hour % 12 + 12 * (half == "p"), hour)
    digits = polars.coalesce(polars.col("part"), polars.col("milli"), polars.lit("0")).str.slice(0, 9)
    nanos = fields.select(nanos=digits.str.pad_end(9, "0").cast(polars.Int64))["nanos"].to_numpy()
    of_day = hour * 3600 + minute * 60 + second
    has_zone = np.zeros(len(texts), dtype=bool)
    if form == "time":
        return Cells({"": of_day}, nanos, has_zone, {"": wrong}, int(hour.max(initial=0)))
    has_zone = fields["zone"].is_not_null().to_numpy()
    of_day -= 60 * _minutes_ahead(fields["zone"])
    seconds, wrong_in_order = {}, {}
    for order, month in ORDERS[form].items():
        days, real = _calendar_days(integers("year"), integers(month), integers("two" if month == "one" else "one"))
        seconds[order], wrong_in_order[order] = of_day + DAY * days, wrong | ~real
    return Cells(seconds, nanos, has_zone, wrong_in_order, int(hour.max(initial=0)))


def _minutes_ahead(zone: "polars.Series") -> np.ndarray:
    """Minutes (n,) by which local time is ahead of UTC: +01:00 is 60."""
    import polars

    digits = zone.str.extract(r"([0-9]{2}(?::?[0-9]{2})?)").str.replace(":", "", literal=True).str.pad_end(4, "0")
    number = digits.cast(polars.Int64).fill_null(0).to_numpy()
    sign = np.where(zone.str.starts_with("-").fill_null(value=False).to_numpy(), -1, 1)
    return sign * (number // 100 * 60 + number % 100)


def _calendar_days(year: np.ndarray, month: np.ndarray, day: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Days (n,) since 1970, and which of them are in the calendar."""
    real = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    first = ((year - 1970) * 12 + np.where(real, month, 1) - 1).astype("datetime64[M]")
    date = first.astype("datetime64[D]") + (np.where(real, day, 1) - 1)
    real &= date.astype("datetime64[M]") == first  # not 31 April
    return date.astype(np.int64), real


LIKE = re.compile(r"\d{1,4}[./-]\d{1,2}[./-]\d{2,4}\b.*|.*\d:\d{2}\b.*|\d{4}-\d{2}-\d{2}.*|\d{8}T\d{4,6}.*")
CHUNK = 1 << 17  # cells that are taken apart at a time
WRITE = "write them as 2026-03-29T01:59:55.250 or as seconds, or give the sampling time with --ts"


class _NotReadError(ValueError):
    """Why a column that looks like dates is not read."""


def read_dates(table: Table) -> Table:
    """The table with seconds since the first cell in place of dates and times of day; of several such columns of one
    kind, which may be clocks of their own, since the first cell of the first.

    `dates` says how a column was read; `undated` why one that looks like dates was not: it stays as it is.
    """
    columns, units = list(table.columns), dict(table.units)
    dates, undated, local = {}, {}, dict(table.local)
    origins: dict[str, Origin] = {}
    for j, name in enumerate(table.names):
        cells = table.columns[j]
        if not len(cells) or not isinstance(cells[0], str):
            continue
        first = next((cell.strip() for cell in cells[:CHUNK] if cell.strip()), "")
        if not LIKE.fullmatch(first):
            continue
        try:
            t, dates[name], begins, origin = _read_column(table, j, first)
            earlier = next((each for each in origins if origins[each].kind == origin.kind), "")
            if earlier and (shift := origin.since(origins[earlier])):
                t, begins = t + shift, None if begins is None else begins - shift
                dates[name] += f", counted from the first of {earlier!r}"
            columns[j], origins[name] = t, origin
            local |= {name: begins} if begins is not None else {}
            units[name] = "s"
        except _NotReadError as error:
            undated[name] = f"column {name!r} holds dates or times such as {first[:40]!r}, {error}"
    if not dates and not undated:
        return table
    return replace(table, columns=tuple(columns), units=units, dates=dates, undated=undated, local=local)


@dataclass(frozen=True)
class Origin:
    """The first cell of a column: seconds and nanoseconds since 1970, or since midnight where `kind` is "time"."""

    kind: str
    seconds: int
    nanos: int

    def since(self, other: "Origin") -> float:
        """Seconds since another origin; times of day are within half a day of each other."""
        whole = self.seconds - other.seconds
        whole -= DAY * round(whole / DAY) if self.kind == "time" else 0
        return whole + (self.nanos - other.nanos) / 1e9


def _read_column(table: Table, j: int, first: str) -> tuple[np.ndarray, str, float | None, Origin]:
    """Seconds (n,) since the `first` cell that is not empty, nan for empty ones, and how they were read.

    Then the seconds since 1970 of that cell in local time: nan for a time of day, and for a date with two readings;
    None for times in UTC, and for spans of time. At last its origin.
    """
    places, cells, is_time = _parse_column(table, j, first)
    zoned, orders = cells.zoned, list(cells.seconds)
    if zoned.any() and not zoned.all():
        row = table.rows[j][int(places[int(np.argmin(zoned == zoned[0]))])]
        raise _NotReadError(f"and row {row} differs from it in that only one of them has an offset from UTC; {WRITE}")
    is_span = is_time and cells.longest >= 24
    sentence, values = f"column {table.names[j]!r} was read as seconds since {first[:40]}", np.zeros(0)
    for order, seconds in cells.seconds.items():
        if is_time and not is_span:
            seconds, midnights = _over_midnight(seconds, cells.nanos)
            sentence += f"; midnight passed {'once' if midnights == 1 else f'{midnights} times'}" if midnights else ""
        t = _since_first(seconds, cells.nanos)
        if order != orders[0] and not np.array_equal(t, values):
            raise _NotReadError(
                f"which may be {orders[0]} or {order}, and the date changes within the log; write the year first "
                "(2026-03-29), or give the sampling time with --ts"
            )
        values = t
    column = np.full(len(table.columns[j]), np.nan)
    column[places] = values
    kind = "span" if is_span else "time" if is_time else "zoned" if zoned.any() else "local"
    origin = Origin(kind, int(cells.seconds[orders[0]][0]), int(cells.nanos[0]))
    if kind in ("zoned", "span"):
        return column, sentence, None, origin
    sure = not is_time and len(orders) == 1
    return column, sentence, float(origin.seconds + origin.nanos / 1e9) if sure else np.nan, origin


def _parse_column(table: Table, j: int, first: str) -> tuple[np.ndarray, Cells, bool]:
    """The places (m,) of the cells that are not empty, what these say in every order that makes dates of all cells,
    and whether they are times of day or spans of time.

    The `first` of them tells the form. Raises _NotReadError for a cell of another form, and where no order is left.
    """
    import polars

    form = next((form for form, pattern in FORMS.items() if re.match(pattern, first)), None)
    if form is None:
        raise _NotReadError(f"in a form that is not read; {WRITE}")
    tables.check_fork()
    texts, places, parts = table.columns[j], [], []
    for start in range(0, len(texts), CHUNK):
        chunk = polars.Series([text.strip() for text in texts[start : start + CHUNK]], dtype=polars.String)
        filled = chunk.str.len_bytes() > 0
        places.append(start + np.flatnonzero(filled.to_numpy()))
        part = parse_cells(chunk.filter(filled), form)
        wrong = np.logical_and.reduce(list(part.wrong.values()))
        if wrong.any():
            k = int(places[-1][int(np.argmax(wrong))])
            raise _NotReadError(
                f"and row {table.rows[j][k]} has {texts[k].strip()[:40]!r}, which is none like it; correct the cell, "
                "or give the sampling time with --ts"
            )
        parts.append(part)
    orders = [order for order in ORDERS[form] if not any(part.wrong[order].any() for part in parts)]
    if not orders:
        raise _NotReadError(f"and no order of day and month makes dates of all cells; {WRITE}")
    cells = Cells(
        {order: np.concatenate([part.seconds[order] for part in parts]) for order in orders},
        np.concatenate([part.nanos for part in parts]),
        np.concatenate([part.zoned for part in parts]),
        {},
        max(part.longest for part in parts),
    )
    return np.concatenate(places), cells, form == "time"


def _since_first(seconds: np.ndarray, nanos: np.ndarray) -> np.ndarray:
    """Times (n,) [s] since the first of them."""
    return (seconds - seconds[0]).astype(float) + (nanos - nanos[0]) / 1e9


def _over_midnight(seconds: np.ndarray, nanos: np.ndarray) -> tuple[np.ndarray, int]:
    """Times of day (n,) that go on after midnight, and how often it passed: a fall by more than half a day is one.

    Where the newest stands first, most fall, and a rise by more than half a day is one.
    """
    steps = np.diff(seconds) + np.diff(nanos) / 1e9
    newest_first = np.count_nonzero(steps < 0) > np.count_nonzero(steps > 0)
    passed = -(steps > 0.5 * DAY).astype(int) if newest_first else (steps < -0.5 * DAY).astype(int)
    days = np.concatenate([[0], np.cumsum(passed)])
    return seconds + DAY * days, abs(int(days[-1]))


_DATE = re.compile(
    r"([0-9]{4}[-/.][0-9]{1,2}[-/.][0-9]{1,2}|[0-9]{1,2}([-/.])[0-9]{1,2}\2(?:[0-9]{4}|[0-9]{2}))"
    r"(?:[T ]00:00(?::00(?:\.0*)?)?)?"
)
_MINUTES = re.compile(r"[0-9]{1,2}:[0-9]{2}(?:\s*[AaPp]\.?[Mm]\.?)?")
_DIGITS = re.compile(r"((?:19|20)[0-9]{2})([0-9]{2})([0-9]{2})")  # 20260310, in a column that is called a date
_NAMES = re.compile(r".*(?:date|datum|fecha|day|tag)", re.IGNORECASE)


def with_days(text: Table, table: Table) -> Table:
    """`table` with the days of a column of dates beside its times of day; `text` is the table before they were read.

    A date that stays, or changes where the time passes midnight, changes nothing. Where it says more, both are one
    clock; where it cannot be read so, the times are `undated` and say why.
    """
    times = [name for name in table.dates if re.match(FORMS["time"], _first_text(text, name))]
    times = times or [name for name in table.undated if _MINUTES.fullmatch(_first_text(text, name))]
    if len(times) != 1:
        return table
    days = [name for name in text.names if name not in times and _is_date(name, _first_text(text, name))]
    if len(days) != 1:
        return table
    name, i, j = times[0], text.names.index(days[0]), text.names.index(times[0])
    dates_of_rows = _dates_by_row(_cells_of_text(text, days[0]))
    changes = np.flatnonzero([a != b for a, b in pairwise(dates_of_rows)]) + 1
    cells = _cells_of_text(text, name)
    in_minutes = name in table.undated  # 12:05, which is a time of day where a date stands beside it
    if not (len(changes) or in_minutes) or len(dates_of_rows) != len(cells):
        return table
    joined_cells = [
        f"{day} {cell.strip()}" if cell.strip() else "" for day, cell in zip(dates_of_rows, cells, strict=True)
    ]
    readings = _readings(replace(text, columns=(*text.columns[:j], joined_cells, *text.columns[j + 1 :])), j)
    time = np.empty(0) if in_minutes else np.asarray(table.columns[j], dtype=float)
    if not in_minutes and any(np.allclose(t, time, rtol=0.0, atol=1e-6, equal_nan=True) for t, _ in readings):
        return table
    if not readings and in_minutes:
        return table
    if not readings:
        midnights = np.flatnonzero(np.diff(np.floor(_since_midnight(time, cells) / DAY)) != 0) + 1
        if np.array_equal(changes, midnights):
            return table
    if len(readings) == 1:
        t, begins = readings[0]
        columns = tuple(t if k == j else dates_of_rows if k == i else column for k, column in enumerate(table.columns))
        first = next(filter(None, joined_cells))
        sentence = f"columns {days[0]!r} and {name!r} were read together as seconds since {first}"
        local = {**table.local, name: begins}
        dates = {key: note for key, note in table.dates.items() if key != days[0]}
        undated = {key: note for key, note in table.undated.items() if key not in (name, days[0])}
        units = {**table.units, name: "s"}
        return replace(
            table, columns=columns, dates={**dates, name: sentence}, undated=undated, local=local, units=units
        )
    reason = (
        f"column {name!r} holds times of day, and {days[0]!r} beside it changes in row {text.rows[j][int(changes[0])]} "
        f"in another way than they pass midnight; put both into one column: {WRITE}"
    )
    return replace(_with_text_again(table, text, name), undated={name: reason, **table.undated})


def _with_text_again(table: Table, text: Table, name: str) -> Table:
    """The table in which a column is text again."""
    j = table.names.index(name)
    columns = (*table.columns[:j], text.columns[j], *table.columns[j + 1 :])
    remaining = {key: sentence for key, sentence in table.dates.items() if key != name}
    units = {key: unit for key, unit in table.units.items() if key != name or key not in table.dates}
    return replace(table, columns=columns, dates=remaining, units=units)


def _cells_of_text(table: Table, name: str) -> Sequence[str]:
    cells = table.columns[table.names.index(name)]
    if not isinstance(cells, np.ndarray):
        return cells
    is_date = cells.dtype.kind in "fiu" and np.all((cells > 19e6) & (cells < 21e6))
    if is_date and np.all(cells % 1 == 0):
        return [str(int(cell)) for cell in cells]  # 20260310 was read as a number
    return []


def _first_text(table: Table, name: str) -> str:
    cells = _cells_of_text(table, name)
    if not len(cells) or not isinstance(cells[0], str):
        return ""
    return next((cell.strip() for cell in cells if cell.strip()), "")


def _is_date(name: str, first: str) -> bool:
    return bool(_DATE.fullmatch(first) or (_DIGITS.fullmatch(first) and _NAMES.fullmatch(name)))


def _dates_by_row(cells: Sequence[str]) -> list[str]:
    """The date of each row, without a midnight behind it; an empty cell has the date above it."""
    dates_of_rows, last = [], ""
    date_of_cell: dict[str, str] = {}
    for cell in cells:
        if cell not in date_of_cell:
            text = cell.strip()
            date, digits = _DATE.fullmatch(text), _DIGITS.fullmatch(text)
            date_of_cell[cell] = date[1] if date else "-".join(digits.groups()) if digits else text
        last = date_of_cell[cell] or last
        dates_of_rows.append(last)
    return dates_of_rows


def _since_midnight(seconds: np.ndarray, cells: Sequence[str]) -> np.ndarray:
    """Seconds (n,) since the first midnight."""
    hour, minute, second = (float(part) for part in re.findall(r"[0-9]+", next(c for c in cells if c.strip()))[:3])
    return seconds + 3600 * hour + 60 * minute + second


def _readings(table: Table, j: int) -> list[tuple[np.ndarray, float]]:
    """The different readings of column j: seconds (n,) since its first cell, and that cell since 1970 [s]."""
    try:
        places, cells, _ = _parse_column(table, j, next(filter(None, table.columns[j]), ""))
    except _NotReadError:
        return []
    readings: list[tuple[np.ndarray, float]] = []
    for seconds in cells.seconds.values():
        t = np.full(len(table.columns[j]), np.nan)
        t[places] = _since_first(seconds, cells.nanos)
        if not any(np.array_equal(t, reading, equal_nan=True) for reading, _ in readings):
            readings.append((t, float(seconds[0] + cells.nanos[0] / 1e9)))
    return readings

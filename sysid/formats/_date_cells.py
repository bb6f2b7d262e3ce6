"""Texts of dates and times of day taken apart: seconds and nanoseconds of each, in every order of day and month."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import polars

# [0-9]: \d has the digits of other scripts too, of which polars makes no number.
_TIME = (
    r"(?P<hour>[0-9]{1,3}):(?P<minute>[0-9]{2}):(?P<second>[0-9]{2})(?:[.,](?P<part>[0-9]{1,18})|:(?P<milli>[0-9]{3}))?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_ZONE = r"\s*(?P<zone>[Zz]|UTC|[+-][0-9]{2}(?::?[0-9]{2})?)?"
_YEAR, _ONE, _TWO = "(?P<year>[0-9]{4})", "(?P<one>[0-9]{1,2})", "(?P<two>[0-9]{1,2})"
FORMS = {
    "time": rf"^{_TIME}$",
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


def taken_apart(texts: "polars.Series", form: str) -> Cells:
    """What texts (n,) without blanks around them say in a form of `FORMS`."""
    import polars

    fields = texts.str.extract_groups(FORMS[form]).struct.unnest()

    def whole(name: str) -> np.ndarray:
        return fields[name].cast(polars.Int64).fill_null(0).to_numpy()

    hour, minute, second = whole("hour"), whole("minute"), whole("second")
    half = fields["half"].str.to_lowercase().fill_null("").to_numpy()
    halved = half != ""
    wrong = fields["hour"].is_null().to_numpy() | (minute > 59) | (second > 59)
    wrong |= halved & ((hour < 1) | (hour > 12))
    wrong |= (hour > 23) & (form != "time")
    hour = np.where(halved, hour % 12 + 12 * (half == "p"), hour)
    digits = polars.coalesce(polars.col("part"), polars.col("milli"), polars.lit("0")).str.slice(0, 9)
    nanos = fields.select(nanos=digits.str.pad_end(9, "0").cast(polars.Int64))["nanos"].to_numpy()
    of_day = hour * 3600 + minute * 60 + second
    zoned = np.zeros(len(texts), dtype=bool)
    if form == "time":
        return Cells({"": of_day}, nanos, zoned, {"": wrong}, int(hour.max(initial=0)))
    zoned = fields["zone"].is_not_null().to_numpy()
    of_day -= 60 * _minutes_ahead(fields["zone"])
    seconds, none = {}, {}
    for order, month in ORDERS[form].items():
        days, real = _days(whole("year"), whole(month), whole("two" if month == "one" else "one"))
        seconds[order], none[order] = of_day + DAY * days, wrong | ~real
    return Cells(seconds, nanos, zoned, none, int(hour.max(initial=0)))


def _minutes_ahead(zone: "polars.Series") -> np.ndarray:
    """Minutes (n,) by which local time is ahead of UTC: +01:00 is 60."""
    import polars

    digits = zone.str.extract(r"([0-9]{2}(?::?[0-9]{2})?)").str.replace(":", "", literal=True).str.pad_end(4, "0")
    number = digits.cast(polars.Int64).fill_null(0).to_numpy()
    sign = np.where(zone.str.starts_with("-").fill_null(value=False).to_numpy(), -1, 1)
    return sign * (number // 100 * 60 + number % 100)


def _days(year: np.ndarray, month: np.ndarray, day: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Days (n,) since 1970, and which of them are in the calendar."""
    real = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    first = ((year - 1970) * 12 + np.where(real, month, 1) - 1).astype("datetime64[M]")
    date = first.astype("datetime64[D]") + (np.where(real, day, 1) - 1)
    real &= date.astype("datetime64[M]") == first  # not 31 April
    return date.astype(np.int64), real

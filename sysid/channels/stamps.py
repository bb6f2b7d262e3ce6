"""The time stamps of a log: counters that wrapped, stamps that repeat or run back, and the clock's resolution.

Dates and times of day may have no offset from UTC; then an hour is lost or comes twice when clocks change.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.clock import within_counter
from sysid.channels.conversion import seconds
from sysid.channels.mapping import Clock, Repair
from sysid.channels.repair import Correction, without_rows
from sysid.channels.restarts import restarts, usual_step
from sysid.data.table import Table

# Limits chosen by hand; the logs of tests/corpus hold them.
MOST_REPEATED = 0.1  # share of stamps that repeat; more is a clock too coarse for its samples, not a fault
NEAR = 5  # stamps on either side of one that repeats; fewer repeats than these are a fault of single rows
CHUNK = 1 << 18  # numbers that are looked at together: copies of a long record would be what needs most memory
DIGITS = 9  # decimals of a stamp in the file's unit that are looked at
HOUR = 3600.0  # [s]
HOUR_TOLERANCE = 0.01  # of an hour and of a step: what is so near an hour off is a change of clocks
MONTHS = (3, 4, 9, 10, 11)  # in which clocks are changed, north or south
NIGHT = (-4.0, 5.0)  # [h] from the midnight between Saturday and Sunday
SHORT = 20 * 60.0  # [s] below that an hour is a gap that is refused anyway, or a stamp that runs back
PLACES = 300  # between two stamps that are looked at
IN_UTC = "write dates in UTC or with their offset"


@dataclass(frozen=True)
class Stamps:
    """Increasing times t (n,) [s] from the first stamp; `rows` (n,) are the positions in the table.

    `group` (all rows,) is the position in t of the stamp that a row belongs to, -1 for a row that was dropped.
    `resolution` [s] is the last digit of the stamps, 0 if they have more than nine decimals. `corrections` are of
    wraps, of stamps that repeat or run back, and of rows without a stamp.
    """

    t: np.ndarray
    rows: np.ndarray
    group: np.ndarray
    first: float
    resolution: float
    corrections: tuple[Correction, ...] = ()

    @property
    def repeated(self) -> bool:
        """Whether several rows have one stamp."""
        return any(correction.counts.get("duplicates") for correction in self.corrections)


def read_stamps(table: Table, clock: Clock, repair: Repair, raw: np.ndarray) -> Stamps:
    """Stamps of the clock's column `raw` (n,) in its unit; nan marks a cell without a value.

    Raises InputError with the row for a stamp outside the counter, one that runs back, and too many that repeat.
    """
    rows = np.flatnonzero(np.isfinite(raw))
    if len(rows) < 2:
        raise InputError(f"{table.path} has {len(rows)} time stamp(s); at least 2 rows are needed")
    empty = without_rows("stamps without a value", np.flatnonzero(~np.isfinite(raw)), "without a stamp left out")
    values = values_at(raw, rows)
    resolution = last_digit(values)
    values, wraps = unwrap_counter(table, clock, values, rows)
    backward = np.zeros(0, dtype=int)
    if repair.backward == "drop" and np.any(np.diff(values) < 0):
        stamps = np.full(len(raw), np.nan)
        stamps[rows] = values
        again = restarts(stamps, table)
        if len(again):
            raise table.error(
                clock.column,
                int(again[0]),
                f"the clock starts again here ({len(again)} such place(s)), and rows before and behind are not of one "
                'record: backward = "drop" would join them; leave it out',
            )
        keep = longest_rising(values)
        backward = rows[~keep]
        rows, values = rows[keep], values[keep]
    _check_increasing(table, clock, values, rows)
    fresh = np.ones(len(values), dtype=bool)
    np.greater(values[1:], values[:-1], out=fresh[1:])
    repeated = not fresh.all()
    if repeated:
        _check_repeated(table, clock, repair, fresh, values, rows)
    group = rows
    if repeated or len(rows) < len(raw):
        group = np.full(len(raw), -1)
        group[rows] = np.cumsum(fresh) - 1
    factor, origin = seconds(clock.unit), values[0]
    t = values[fresh]
    t -= origin
    t *= factor
    if len(t) < 2:
        raise InputError(f"{table.path}: column {clock.column!r} has one time stamp; at least 2 are needed")
    action = "averaged" if repair.duplicates == "mean" else "left out"
    corrections = (
        wraps,
        without_rows("duplicates", rows[~fresh], f"with the stamp of the row before {action}"),
        without_rows("backward", backward, "whose stamp runs back left out"),
        empty,
    )
    rows = rows[fresh] if repeated else rows
    return Stamps(t, rows, group, float(origin * factor), resolution * factor, corrections)


def values_at(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The values (n,) of increasing rows (m,): no copy if these are all."""
    return values if len(rows) == len(values) else values[rows]


def unwrap_counter(table: Table, clock: Clock, values: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, Correction]:
    """The counter as it would be without its wraps: a drop by more than half of the range is one."""
    period = clock.period
    if not period:
        return values, Correction({}, "")
    outside = ~within_counter(values, period)
    if outside.any():
        k = int(np.argmax(outside))
        raise table.error(
            clock.column,
            int(rows[k]),
            f"found {values[k]:.10g} in a counter that starts again after {period:.10g}; set period of [clock] in the "
            "mapping to what it counts, or leave it out if it never starts again",
        )
    falls = np.diff(values) < -0.5 * period
    values = values + period * np.concatenate([[0.0], np.cumsum(falls)])
    count = int(falls.sum())
    times = "once" if count == 1 else f"{count} times"
    words = f"the clock that counts to {period:.10g} started again {times}; undone"
    return values, Correction({"wraps": count}, words, rows[1:][falls])


def last_digit(values: np.ndarray) -> float:
    """The smallest power of ten down to 1e-9 that has as few decimals as `values` (n,) have; 0 if they have many."""
    size = 8 * np.spacing(max(abs(values.max()), abs(values.min())))

    def has_decimals(sample: np.ndarray, digits: int) -> bool:
        for start in range(0, len(sample), CHUNK):
            multiples = sample[start : start + CHUNK] * 10.0**digits
            if not np.all(np.abs(multiples - np.rint(multiples)) <= 1e-6 + size * 10.0**digits):
                return False
        return True

    sample_of_values = values[:: max(1, len(values) // 1000)]
    for digits in range(DIGITS + 1):
        if has_decimals(sample_of_values, digits) and has_decimals(values, digits):
            return float(10.0**-digits)
    single = np.float32
    if all(np.array_equal(part, part.astype(single)) for part in np.array_split(values, len(values) // CHUNK + 1)):
        return float(np.spacing(single(np.abs(values).max())))  # stamps that were kept in 32 bits
    return 0.0


def longest_rising(values: np.ndarray) -> np.ndarray:
    """Marks (n,) of a longest subsequence that never falls: fewest rows are left out (patience sorting)."""
    tops: list[float] = []
    places: list[int] = []
    predecessors = np.full(len(values), -1)
    for k, value in enumerate(values.tolist()):
        pile = bisect_right(tops, value)
        predecessors[k] = places[pile - 1] if pile else -1
        if pile == len(tops):
            tops.append(value)
            places.append(k)
        else:
            tops[pile], places[pile] = value, k
    keep = np.zeros(len(values), dtype=bool)
    k = places[-1]
    while k >= 0:
        keep[k] = True
        k = int(predecessors[k])
    return keep


def _check_increasing(table: Table, clock: Clock, values: np.ndarray, rows: np.ndarray) -> None:
    """Raises InputError for the first stamp behind a change of clocks, or that runs back."""
    factor = seconds(clock.unit)
    if (change := _change_of_clocks(table, clock, values)) is not None:
        raise table.error(clock.column, int(rows[change[0]]), change[1])
    falls = np.flatnonzero(values[1:] < values[:-1])
    if not len(falls):
        return
    k = int(falls[0]) + 1
    origin = 0.0 if values[0] == 0 or abs(values[0]) * factor < 1e6 else values[0]
    stamp, previous = (values[k] - origin) * factor, (values[k - 1] - origin) * factor
    note = note_on_change_of_clocks(table, clock, stamp - previous, usual_step(values) * factor)
    remedy = ", or give the sampling time with --ts if the rows are uniform"  # all rows are good
    if not note:
        remedy = (
            ': remove the row, or set backward = "drop" in [repair] of a mapping, or period in [clock] of a counter'
        )
    raise table.error(
        clock.column,
        int(rows[k]),
        f"found {stamp:.9g} s after {previous:.9g} s ({len(falls)} such step(s)){note}; time must increase{remedy}",
    )


def _check_repeated(
    table: Table, clock: Clock, repair: Repair, fresh: np.ndarray, values: np.ndarray, rows: np.ndarray
) -> None:
    """Raises InputError for the first stamp that repeats, where none may, or where too many do."""
    k, count = int(np.argmin(fresh)), int((~fresh).sum())
    message = f"found {values[k] * seconds(clock.unit):.9g} s again"
    if repair.duplicates == "refuse":
        raise table.error(clock.column, int(rows[k]), f"{message}; time must increase: remove the row")
    if count > MOST_REPEATED * len(fresh) or _is_rounded(values, fresh):
        raise table.error(
            clock.column,
            int(rows[k]),
            f"{message}, as {count} of {len(fresh)} stamps are; the clock is too coarse for its samples: give the "
            "sampling time with --ts instead, or in [clock] of a mapping without a column",
        )


def _is_rounded(values: np.ndarray, fresh: np.ndarray) -> bool:
    """Whether stamps repeat where their last digit is longer than a step, as those with five digits do after 1000 s."""
    step = float(np.median(np.diff(values)))
    repeats = np.flatnonzero(~fresh)
    sample, coarse = repeats[:: max(1, len(repeats) // 50)], 0
    for k in sample.tolist():
        steps = np.diff(values[max(0, k - NEAR) : k + NEAR])
        coarse += bool(np.min(steps, where=steps > 0, initial=np.inf) > 1.5 * step)
    return bool(len(repeats) >= NEAR and coarse > 0.5 * len(sample))


def is_hour(difference: np.ndarray | float, usual: float) -> np.ndarray:
    """Whether a step differs by about an hour from the `usual` one [s]."""
    return np.asarray(np.abs(np.abs(difference) - HOUR) <= HOUR_TOLERANCE * (HOUR + usual))


def note_on_change_of_clocks(table: Table, clock: Clock, step: float, usual: float) -> str:
    """What a step [s] between dates may be that is an hour off the `usual` one; else nothing."""
    if clock.column not in table.local or not is_hour(step - usual, usual):
        return ""
    return f", about an hour, as a local clock makes at the change of clocks: {IN_UTC}"


def _change_of_clocks(table: Table, clock: Clock, values: np.ndarray) -> tuple[int, str] | None:
    """The place of the first stamp (n,) [s] behind a change of clocks, and the sentence; None if there is none.

    A slow log does not show it otherwise: the hour is a lost sample, or a stamp that repeats. Where the date is known,
    only nights in which clocks are changed count; samples that are lost at other times are filled.
    """
    if clock.column not in table.local or len(values) < 3:
        return None
    steps, usual = np.diff(values), usual_step(values)
    if usual < SHORT:
        return None
    for k in np.flatnonzero(is_hour(steps - usual, usual)).tolist():
        low, high = sorted((values[k], values[k] + usual))
        if _clocks_may_change(table.local[clock.column], low, high):
            change = "more" if steps[k] > usual else "less"
            return k + 1, (
                f"found a step of {steps[k]:.6g} s where most are {usual:.6g} s: an hour {change}, as a local clock "
                f"makes at the change of clocks; {IN_UTC}, or give the sampling time with --ts if the rows are uniform"
            )
    return None


def _clocks_may_change(origin: float, low: float, high: float) -> bool:
    """Whether clocks may be changed between two local times [s]; `origin` is nan where the date is not known."""
    places = np.linspace(low, high, PLACES)
    if np.isnan(origin):
        return True
    days = (origin + places) / 86400.0
    from_sunday = ((days + 4.0 + 3.5) % 7.0 - 3.5) * 24.0  # 1970 began on a Thursday
    months = days.astype("datetime64[D]").astype("datetime64[M]").astype(int) % 12 + 1
    return bool(np.any(np.isin(months, MONTHS) & (from_sunday >= NIGHT[0]) & (from_sunday <= NIGHT[1])))

"""The time stamps of a log: counters that wrapped, stamps that repeat or run back, and the clock's resolution."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.local_time import change_of_clocks, changed
from sysid.channels.mapping import Clock, Repair
from sysid.channels.units import seconds
from sysid.data.table import Table

MOST_REPEATED = 0.1  # share of stamps that repeat; more is a clock too coarse for its samples, not a fault
NEAR = 5  # stamps on either side of one that repeats; fewer repeats than these are a fault of single rows
CHUNK = 1 << 18  # numbers that are looked at together: copies of a long record would be what needs most memory
DIGITS = 9  # decimals of a stamp in the file's unit that are looked at


@dataclass(frozen=True)
class Stamps:
    """Increasing times t (n,) [s] from the first stamp; `rows` (n,) are the positions in the table.

    `group` (all rows,) is the position in t of the stamp that a row belongs to, -1 for a row that was dropped.
    `resolution` [s] is the last digit of the stamps, 0 if they have more than nine decimals.
    """

    t: np.ndarray
    rows: np.ndarray
    group: np.ndarray
    first: float
    resolution: float
    wraps: int = 0
    duplicates: int = 0
    backward: int = 0
    empty: int = 0


def read_stamps(table: Table, clock: Clock, repair: Repair, raw: np.ndarray) -> Stamps:
    """Stamps of the clock's column `raw` (n,) in its unit; nan marks a cell without a value.

    Raises InputError with the row for a stamp outside the counter, one that runs back, and too many that repeat.
    """
    known = np.flatnonzero(np.isfinite(raw))
    if len(known) < 2:
        raise InputError(f"{table.path} has {len(known)} time stamp(s); at least 2 rows are needed")
    values = taken(raw, known)
    resolution = last_digit(values)
    values, wraps = unwrapped(table, clock, values, known)
    factor = seconds(clock.unit)
    keep, backward = np.ones(len(values), dtype=bool), 0
    if repair.backward == "drop" and np.any(np.diff(values) < 0):
        keep = increasing(values)
        backward = int((~keep).sum())
    if not keep.all():
        known, values = known[keep], values[keep]
    if (found := changed(table, clock, values)) is not None:
        raise table.error(table.names.index(clock.column), int(known[found[0]]), found[1])
    _check_back(table, clock, values, known, factor)
    fresh = np.ones(len(values), dtype=bool)
    np.greater(values[1:], values[:-1], out=fresh[1:])
    duplicates = int((~fresh).sum())
    if duplicates:
        _check_repeated(table, clock, repair, fresh, values, known, factor)
    group = known
    if duplicates or len(known) < len(raw):
        group = np.full(len(raw), -1)
        group[known] = np.cumsum(fresh) - 1
    origin = values[0]
    t = values[fresh]
    t -= origin
    t *= factor
    if len(t) < 2:
        raise InputError(f"{table.path}: column {clock.column!r} has one time stamp; at least 2 are needed")
    return Stamps(
        t,
        known[fresh] if duplicates else known,
        group,
        float(origin * factor),
        resolution * factor,
        wraps,
        duplicates,
        backward,
        len(raw) - int(np.isfinite(raw).sum()),
    )


def taken(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The values (n,) of increasing rows (m,): no copy if these are all."""
    return values if len(rows) == len(values) else values[rows]


def unwrapped(table: Table, clock: Clock, values: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, int]:
    """The counter as it would be without its wraps, and their number: a drop by more than half of the range is one."""
    if not clock.wrap:
        return values, 0
    period = 2.0**clock.wrap
    outside = ~within_counter(values, clock.wrap)
    if outside.any():
        k = int(np.argmax(outside))
        raise table.error(
            table.names.index(clock.column),
            int(rows[k]),
            f"found {values[k]:.10g} in a counter of {clock.wrap} bits; set wrap of [clock] in the mapping to the bits "
            "of the counter, or to 0 if it never starts again",
        )
    turned = np.diff(values) < -0.5 * period
    return values + period * np.concatenate([[0.0], np.cumsum(turned)]), int(turned.sum())


def within_counter(values: np.ndarray, bits: int) -> np.ndarray:
    """Which of `values` (n,) a counter of so many bits can show; one with numbers below 0 is written with a sign."""
    lowest = -(2.0 ** (bits - 1)) if np.any(values < 0) else 0.0
    return np.asarray((values >= lowest) & (values < lowest + 2.0**bits))


def last_digit(values: np.ndarray) -> float:
    """The step between neighbouring numbers with as many decimals as `values` (n,) have; 0 if they have many."""
    size = 8 * np.spacing(max(abs(values.max()), abs(values.min())))

    def whole(all_of_them: np.ndarray, digits: int) -> bool:
        for start in range(0, len(all_of_them), CHUNK):
            scaled = all_of_them[start : start + CHUNK] * 10.0**digits
            if not np.all(np.abs(scaled - np.rint(scaled)) <= 1e-6 + size * 10.0**digits):
                return False
        return True

    few = values[:: max(1, len(values) // 1000)]
    for digits in range(DIGITS + 1):
        if whole(few, digits) and whole(values, digits):
            return float(10.0**-digits)
    single = np.float32
    if all(np.array_equal(part, part.astype(single)) for part in np.array_split(values, len(values) // CHUNK + 1)):
        return float(np.spacing(single(np.abs(values).max())))  # stamps that were kept in 32 bits
    return 0.0


def increasing(values: np.ndarray) -> np.ndarray:
    """Marks (n,) of a longest subsequence that never falls: fewest rows are left out (patience sorting)."""
    tops: list[float] = []
    where: list[int] = []
    before = np.full(len(values), -1)
    for k, value in enumerate(values.tolist()):
        pile = bisect_right(tops, value)
        before[k] = where[pile - 1] if pile else -1
        if pile == len(tops):
            tops.append(value)
            where.append(k)
        else:
            tops[pile], where[pile] = value, k
    keep = np.zeros(len(values), dtype=bool)
    k = where[-1]
    while k >= 0:
        keep[k] = True
        k = int(before[k])
    return keep


def _check_back(table: Table, clock: Clock, values: np.ndarray, rows: np.ndarray, factor: float) -> None:
    back = np.flatnonzero(values[1:] < values[:-1])
    if not len(back):
        return
    k = int(back[0]) + 1
    now, before = (values[k] - values[0]) * factor, (values[k - 1] - values[0]) * factor
    if values[0] == 0 or abs(values[0]) * factor < 1e6:
        now, before = values[k] * factor, values[k - 1] * factor
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    why = change_of_clocks(table, clock, now - before, usual * factor)
    raise table.error(
        table.names.index(clock.column),
        int(rows[k]),
        f"found {now:.9g} s after {before:.9g} s ({len(back)} such step(s)){why}; time must increase: remove the row, "
        'or set backward = "drop" in [repair] of a mapping, or wrap in [clock] if a counter starts again',
    )


def _check_repeated(
    table: Table, clock: Clock, repair: Repair, fresh: np.ndarray, values: np.ndarray, rows: np.ndarray, factor: float
) -> None:
    k, count = int(np.argmin(fresh)), int((~fresh).sum())
    j = table.names.index(clock.column)
    if repair.duplicates == "refuse":
        raise table.error(
            j, int(rows[k]), f"found {values[k] * factor:.9g} s again; time must increase: remove the row"
        )
    if count > MOST_REPEATED * len(fresh) or _is_rounded(values, fresh):
        raise table.error(
            j,
            int(rows[k]),
            f"found {values[k] * factor:.9g} s again, as {count} of {len(fresh)} stamps are; the clock is too coarse "
            "for its samples: give the sampling time with --ts instead, or in [clock] of a mapping without a column",
        )


def _is_rounded(values: np.ndarray, fresh: np.ndarray) -> bool:
    """Whether stamps repeat where their last digit is longer than a step, as those with five digits do after 1000 s."""
    step = float(np.median(np.diff(values)))
    again = np.flatnonzero(~fresh)
    some, coarse = again[:: max(1, len(again) // 50)], 0
    for k in some.tolist():
        around = np.diff(values[max(0, k - NEAR) : k + NEAR])
        coarse += bool(np.min(around, where=around > 0, initial=np.inf) > 1.5 * step)
    return bool(len(again) >= NEAR and coarse > 0.5 * len(some))


__all__ = ["Stamps", "increasing", "last_digit", "read_stamps", "unwrapped"]

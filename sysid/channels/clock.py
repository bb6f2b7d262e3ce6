"""What a clock is: the unit of its stamps, the bits of a counter, and the sampling time that the file states beside it.

A file may say these things twice and differently; then a sentence says so.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.channels.column import Column, Header, unit_in_brackets, words
from sysid.channels.conversion import ALONE, ANYWHERE, DIGITS, TIMES, UNSURE, convert, is_time, seconds, time_word
from sysid.channels.mapping import Bits, Clock
from sysid.data.table import Table
from sysid.formats import sampling_times

CLOCK_WORDS = words(
    "t time timestamp timestamps stamp clock millis micros elapsed ms us ns seconds sec secs msec usec zeit"
)
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
STAMPS = ("ts", "times")  # names that end in s and say no unit
UNITS_SINCE_1970 = {**UNITS, "ns": 1e-9}
# Limits chosen by hand; the logs of tests/corpus hold them.
STEPS = (2e-4, 10.0)  # [s] between samples of an actuator's log; a unit that gives another step is implausible
SINCE_1970 = (1e9, 4e9)  # [s] stamps of the years 2001 to 2096
DAY = 86400.0  # [s]
DAYS = ((2e4, 8e4), (7e5, 8e5))  # serial dates of spreadsheets and of MATLAB, of about our years
TICKS = (1e17, 1e18)  # of 100 ns since the year 1601 or 1, today
WRAPS: tuple[Bits, ...] = (16, 32)
NEAR_WRAP = 20  # steps: a counter that starts again was at most so far from its end
TOLERANCE = 0.1  # of a step: lost samples, a rounded clock and a rig that is slower than it was told stay below
UNIT_OF_TS = ("ts_unit", "tsunit", "ts_units", "unit", "units", "time_unit", "timeunit")
SECONDS = ("", "s", "sec", "secs", "second", "seconds")
PLAUSIBLE = (1e-9, 1e8)  # [s] of a sampling time that a file states
SAME_TIME = 0.01  # of a step, by which two clocks of the same time may differ without a word


@dataclass(frozen=True)
class ClockUnit:
    """The unit of a clock and why; None and what is unclear.

    `stated` is False where the file names no unit, and the step alone speaks for this one.
    """

    unit: str | None
    why: str
    stated: bool = True


def is_named_clock(header: Header) -> bool:
    """Whether the name of a column says that it is a clock."""
    return header.has(CLOCK_WORDS) or header.base.lower() in CLOCK_WORDS


def unit_of_clock(column: Column) -> ClockUnit:
    """The unit of a clock: what the file says, as far as it does not contradict itself; else what is plausible."""
    if column.dated:
        return ClockUnit("s", "it holds dates or times of day")
    if column.timed:
        return ClockUnit("s", "it holds times by its type in the file")
    if sentence := digits_of_a_day(column.name):
        return ClockUnit(None, sentence)
    remedy = how_to_say_unit(column.name)
    if column.unit_conflict:
        return ClockUnit(None, f"{column.unit_conflict}; {remedy}")
    reading = _unit_by_name(column, remedy)
    if reading is None:
        return _unit_by_size(column)
    other = "" if reading.unit is None else _other_unit_since_1970(column, reading.unit)
    if not other:
        return reading
    return ClockUnit(
        None,
        f"column {column.name!r} names {reading.unit}, and its stamps near {float(column.finite.max()):.6g} count from "
        f"1970 in {other}; {how_to_say_unit(column.name, other)}",
    )


def how_to_say_unit(name: str, unit: str = "s") -> str:
    """What to give so that the clock of this name has a unit, such as `unit`: a part of a command that can be typed."""
    return f"say which with --time {name!r} --time-unit {unit} (or another), or as unit of [clock] in a mapping"


def digits_of_a_day(name: str) -> str:
    """A sentence if a name says that the numbers are digits of times of day, as hhmmss does; else nothing."""
    word = next((word for word in name.lower().replace("-", "_").split("_") if DIGITS.fullmatch(word)), "")
    return word and (
        f"column {name!r} holds times of day written as one number ({word}), which are no count of a unit; write them "
        "as 09:00:00, or give the sampling time with --ts"
    )


def _unit_by_name(column: Column, remedy: str) -> ClockUnit | None:
    """The unit that the header or a word of the name says; None if they say none."""
    header, subject = column.header, f"column {column.name!r} may be the clock"
    if header.unit:
        if is_time(header.unit):
            return ClockUnit(header.unit, "its header says so")
        return ClockUnit(None, f"{subject}, but its unit {header.unit!r} is no unit of time; {remedy}")
    if text := unit_in_brackets(column.name):
        if is_time(text):
            return ClockUnit(text, "its header says so")
        return ClockUnit(None, f"{subject}, but {text!r} is no unit of time (s, ms, us, ns, min, h, day); {remedy}")
    units = sorted({ANYWHERE[word] for word in header.words if word in ANYWHERE})
    if len(units) > 1:
        return ClockUnit(None, f"column {column.name!r} has two units, {units[0]} and {units[1]}; {remedy}")
    if units:
        return ClockUnit(units[0], "its name says so")
    word = "" if header.base.lower() in STAMPS else time_word(header.base)
    if word in UNSURE:
        return ClockUnit(None, f"{subject}, in {ALONE[word]} by its last letter or in another unit; {remedy}")
    return ClockUnit(TIMES[word], "its name says so") if word else None


def _other_unit_since_1970(column: Column, unit: str) -> str:
    """The unit in which stamps count from 1970 beyond doubt, if it is another one than the named `unit`; else nothing.

    In the named unit they are later than 2096, or step faster than an actuator's log and do not count from 1970.
    """
    x, factor = column.finite, seconds(unit)
    low, high, step = float(x.min()), float(x.max()), column.step
    if low <= 0 or not step or (low * factor >= SINCE_1970[0] and high * factor <= SINCE_1970[1]):
        return ""
    for other, size in UNITS_SINCE_1970.items():
        counts = low * size >= SINCE_1970[0] and high * size <= SINCE_1970[1] and step * size <= STEPS[1]
        fine = step * factor < STEPS[0] <= step * size and (size < 1.0 or not column.integer)
        if counts and (fine or high * factor > SINCE_1970[1]):
            return other
    return ""


def _unit_by_size(column: Column) -> ClockUnit:
    """The only unit in which stamps count from 1970, or in which their steps are those of an actuator's log."""
    largest, step = float(np.abs(column.finite).max()), column.step
    if not step:
        return ClockUnit(None, f"column {column.name!r} never rises, as a clock does; give the sampling time with --ts")
    for unit, size in UNITS_SINCE_1970.items() if column.finite.min() > 0 and not counter_bits(column) else ():
        if SINCE_1970[0] <= largest * size <= SINCE_1970[1] and step * size <= STEPS[1]:
            return ClockUnit(unit, "its stamps count from 1970")
    middle = float(np.median(np.abs(column.finite)))  # a single wrong stamp says nothing of the unit
    latest = SINCE_1970[1]
    units = [u for u, size in UNITS.items() if STEPS[0] <= step * size <= STEPS[1] and middle * size <= latest]
    if len(units) == 1:
        return ClockUnit(
            units[0],
            f"it names no unit, and its steps of {step:.6g} are plausible in {units[0]} alone (a step from "
            f"{STEPS[0]:g} to {STEPS[1]:g} s)",
            stated=False,
        )
    if not units and column.integer and TICKS[0] <= middle <= TICKS[1]:
        return ClockUnit(
            None,
            f"column {column.name!r} has stamps near {middle:.3g}, as a clock of 100 ns has (FILETIME, ticks of .NET); "
            "give the sampling time with --ts, or write the stamps in seconds",
        )
    if any(first <= middle <= last for first, last in DAYS) and STEPS[0] <= step * DAY <= STEPS[1]:
        units = [*(units or UNITS), "day"]
    readings = " or ".join(f"{step * {**UNITS, 'day': DAY}[u]:.6g} s (if in {u})" for u in units or UNITS)
    return ClockUnit(
        None,
        f"column {column.name!r} names no unit, and its steps of {step:.6g} may be {readings}; "
        f"{how_to_say_unit(column.name, (units or list(UNITS))[0])}",
        stated=False,
    )


def counter_bits(column: Column) -> Bits:
    """Bits of the counter if every fall of the numbers is one of its wraps, else 0."""
    x = column.finite
    if len(x) < 3 or not column.integer:
        return 0
    steps = np.diff(x)
    falls = steps[steps < 0]
    if not len(falls) or len(falls) > 0.1 * len(steps):
        return 0
    for bits in WRAPS:
        rises = falls + 2.0**bits
        if within_counter(x, 2.0**bits).all() and np.all((rises > 0) & (rises <= NEAR_WRAP * column.step)):
            return bits
    return 0


def within_counter(values: np.ndarray, period: float) -> np.ndarray:
    """Which of `values` (n,) a counter of this period can show; one with numbers below 0 is written with a sign."""
    lowest = -0.5 * period if np.any(values < 0) else 0.0
    return np.asarray((values >= lowest) & (values < lowest + period))


def evenest_clock(clock: Column, clocks: Sequence[Column]) -> Column:
    """The stamp inside the messages of a topic instead of their receive time, where it ticks more evenly."""
    topic, dot, field = clock.name.rpartition(".")
    if not dot or field != "time":
        return clock
    stamps = [c for c in clocks if c.name.startswith(f"{topic}.") and "stamp" in c.name[len(topic) :].lower()]
    return min([clock, *stamps], key=lambda c: float(np.std(np.diff(c.finite))) / c.step)


def clock_distance(clock: Column, second_clock: Column) -> str:
    """What to say of the distance of two clocks of the same time; nothing where it is small."""
    if len(clock.values) != len(second_clock.values):
        return ""
    factor, other_factor = (convert(unit_of_clock(column).unit or "s").factor for column in (clock, second_clock))
    distance = clock.values * factor - second_clock.values * other_factor
    distance = distance[np.isfinite(distance)]
    step = clock.step * factor
    if not len(distance) or not step > 0:
        return ""
    shift, span = -float(np.median(distance)), float(np.ptp(clock.finite)) * factor
    if np.ptp(distance) <= SAME_TIME * step:
        if not SAME_TIME * step < abs(shift) < span:
            return ""  # a clock since 1970, or since the board began, shows the same time as well
        return (
            f", {abs(shift):.4g} s {'later' if shift > 0 else 'earlier'} in every row: input and output of a row are "
            "taken as of one time, whatever clock each of them has; if each has its own, name it as clock of [[input]] "
            "and of [[output]] in a mapping"
        )
    return (
        f", but is up to {np.ptp(distance):.3g} s earlier or later beside it ({np.ptp(distance) / step:.0%} of a "
        f"step); choose it with --time {second_clock.name!r} if it is the better one"
    )


def stated_sampling_time(table: Table, names: Sequence[str] = ("Ts", "dt", "fs")) -> float | None:
    """The sampling time [s] in what the writer said of the record, or of each of its experiments; None if there is
    none, or not one.
    """
    of_parts = list(sampling_times(table.meta, names))
    own = [Ts for part, Ts in of_parts if not part]
    different = {float(f"{Ts:.9g}"): Ts for Ts in own[:1] or (Ts for _, Ts in of_parts)}  # 1/fs is rounded
    return different.popitem()[1] if len(different) == 1 else None


def doubt_of_stated(Ts: float, table: Table, columns: Mapping[str, Column]) -> str:
    """Why the sampling time [s] of the header is not taken, where no column is a clock; else nothing."""
    statement = f"the header says that the sampling time Ts is {Ts:g} s"
    if not PLAUSIBLE[0] <= Ts <= PLAUSIBLE[1]:
        return f"{statement}, which no rig has; give the right one with --ts, or correct the header"
    for name, text in table.meta.items():
        if name.lower() in UNIT_OF_TS and isinstance(text, str) and text.strip().lower() not in SECONDS:
            statement = statement.removesuffix(" s")
            return f"{statement} and {name} {text[:40]!r}; give the sampling time in seconds with --ts"
    for column in columns.values():
        if is_named_clock(column.header) and len(column.finite) > 1:
            falls = np.flatnonzero(np.diff(column.values) < 0)
            rows = table.rows[table.names.index(column.name)]
            place = f" (it falls in {table.place} {rows[int(falls[0]) + 1]})" if len(falls) else " in any row"
            return (
                f"{statement}, and column {column.name!r}, a clock by its name, does not rise{place}; give the "
                "sampling time with --ts, or correct the column"
            )
    return ""


NUMBER = r"(\d+(?:[.,]\d*)?(?:[eE][+-]?\d+)?)"
TIME = re.compile(
    rf"(?:Ts|dt|sampl(?:e|ing)[ _-]?(?:time|period|interval|step))\s*[:=]?\s*{NUMBER}\s*([a-zµμ]*)", re.IGNORECASE
)
RATE = re.compile(rf"(?:fs|sampl(?:e|ing)[ _-]?(?:rate|frequency))\s*[:=]?\s*{NUMBER}\s*([a-z]*)", re.IGNORECASE)
POWERS = (1.0, 1e-3, 1e-6)  # of s, or of periods of Hz, where the unit is left out
POSSIBLE = (1e-7, 1e3)  # [s] of a rig's sampling time: Ts may also be a time stamp, fs a full scale
THOUSANDS_OF = re.compile(r"\d{1,3}(?:[.,]\d{3})+")


def commented_sampling_times(text: str) -> tuple[float, ...]:
    """The sampling times [s] that a comment such as `Ts = 0.01`, `fs: 100` or `sampling rate: 100 Hz` may mean."""
    for pattern, base in ((TIME, "s"), (RATE, "Hz")):
        match = pattern.fullmatch(text.strip().rstrip(";,."))
        if match is None:
            continue
        unit = convert(match[2] or base)
        if not unit.known or unit.unit != ("s" if base == "s" else "1/s"):
            return ()
        spellings = [match[1].replace(",", ".")]
        spellings += [re.sub("[.,]", "", match[1])] if THOUSANDS_OF.fullmatch(match[1]) else []
        values = [value for spelling in spellings if 0.0 < (value := float(spelling)) < np.inf]
        times = [value * unit.factor if base == "s" else 1.0 / (value * unit.factor) for value in values]
        candidates = [time * power for time in times for power in (POWERS if not match[2] else POWERS[:1])]
        return tuple(time for time in candidates if POSSIBLE[0] <= time <= POSSIBLE[1])
    return ()


def contradiction_of_header(table: Table, clock: Clock, values: np.ndarray) -> str:
    """A sentence if the header's Ts is not the step of the clock's `values` (n,); else nothing."""
    Ts = stated_sampling_time(table, ("Ts",))  # dt may be the step of a simulation, of which some rows are kept
    if Ts is None:
        return ""
    return _contradiction(f"the header says that the sampling time Ts is {Ts:g} s", (Ts,), clock, values)


def contradictions_of_comments(table: Table, clock: Clock, values: np.ndarray) -> list[str]:
    """Sentences on comments above a table that state another step than that of the clock's `values` (n,)."""
    statements = [(f"a comment says {text[:40]!r}", commented_sampling_times(text)) for text in table.comments]
    sentences = [_contradiction(statement, times, clock, values) for statement, times in statements if times]
    return [f"{sentence}: the column is used" for sentence in sentences if sentence]


def _contradiction(statement: str, times: tuple[float, ...], clock: Clock, values: np.ndarray) -> str:
    """The statement, and the step of the clock, where none of `times` [s] is that step; else nothing.

    The middle step, the mean of those that rise and the mean of all may be meant, where samples were lost or stamps
    are rounded.
    """
    steps = np.diff(values[np.isfinite(values)])
    rises = steps[steps > 0]
    if not len(rises):
        return ""
    factor = seconds(clock.unit)
    means = [float(step) * factor for step in (np.median(rises), rises.mean(), steps[steps >= 0].mean())]
    if any(abs(a - b) <= TOLERANCE * max(a, b) for a in means for b in times):
        return ""
    return f"{statement}, and column {clock.column!r} steps by {means[0]:.6g} s"

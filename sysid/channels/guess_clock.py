"""Which column is the clock, in what unit, and whether it wrapped: by name, by unit, then by the numbers alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.contradictions import is_time, two_units, written_unit
from sysid.channels.looks import Look
from sysid.channels.mapping import Bits, Clock
from sysid.channels.names import ASIDE, CLOCK, COUNTERS, INPUT, NEVER, OUTPUT, REFERENCE, UNIT_OF_CLOCK
from sysid.channels.same_time import apart, of_source
from sysid.channels.stamps import within_counter
from sysid.channels.units import convert

OWN = "time_s"  # in the logs that this program writes
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
STEPS = (2e-4, 10.0)  # [s] between samples of an actuator's log; a unit that gives another step is implausible
SINCE_1970 = (1e9, 4e9)  # [s] stamps of the years 2001 to 2096
DAY = 86400.0  # [s]
DAYS = ((2e4, 8e4), (7e5, 8e5))  # serial dates of spreadsheets and of MATLAB, of about our years
TICKS = (1e17, 1e18)  # of 100 ns since the year 1601 or 1, today
WRAPS: tuple[Bits, ...] = (16, 32)
NEAR_WRAP = 20  # steps: a counter that starts again was at most so far from its end


@dataclass
class ClockGuess:
    """The clock, None if there is none; why; what is unclear; and remarks on entries of the mapping.

    `aside` is a column of stamps that are not used.
    """

    clock: Clock | None = None
    why: list[str] = field(default_factory=list)
    unclear: list[str] = field(default_factory=list)
    remarks: dict[str, str] = field(default_factory=dict)
    aside: str = ""


def guess_clock(columns: Mapping[str, Look]) -> ClockGuess:
    """The clock among the columns of a table."""
    found = ClockGuess()
    named = _named(columns)
    if not named:
        _by_numbers(columns, found)
        return found
    look = named[0]
    if len(named) > 1:
        chosen = _one_of(named)
        if chosen is None:
            names = ", ".join(repr(each.name) for each in named)
            found.unclear.append(f"{names} may each be the clock and do not agree; name one with --time")
            found.remarks["clock.column"] = f"not sure: one of {names}"
            found.clock = Clock(column=look.name)
            return found
        look = chosen
        found.why += [
            f"column {look.name!r} is the clock; {each.name!r} shows the same time{_apart(look, each)}"
            for each in named
            if each is not look
        ]
    describe(look, found)
    return found


def describe(look: Look, found: ClockGuess) -> None:
    """Puts the clock of this column into `found`: its unit, why, and whether it wrapped."""
    unit, why = _unit(look)
    if unit is None:
        found.unclear.append(why)
        found.remarks["clock.unit"] = "NOT SURE"
    else:
        found.why.append(f"column {look.name!r} is the clock, in {unit}: {why}")
    wrap = _wrap(look)
    if wrap:
        found.why.append(f"the clock is a counter of {wrap} bits: it falls by almost 2^{wrap}")
    found.clock = Clock(column=look.name, unit=unit or "s", wrap=wrap)


def clock_of(look: Look, unit: str | None = None) -> tuple[Clock, list[str]]:
    """The clock of a named column, and why it is read so. Raises InputError if its unit is unclear."""
    if unit is not None:
        own, given = look.header.unit or written_unit(look), Clock(column=look.name, unit=unit, wrap=_wrap(look))
        differs = is_time(own) and convert(own).factor != convert(unit).factor
        said = f"column {look.name!r} is the clock, in {unit} as given; its header names {own}"
        return given, [said] if differs else []
    found = ClockGuess()
    describe(look, found)
    if found.unclear:
        raise InputError(found.unclear[0])
    assert found.clock is not None
    return found.clock, found.why


def _named(columns: Mapping[str, Look]) -> list[Look]:
    """Columns that are clocks by name or by unit, and rise."""
    rising = [look for look in columns.values() if not look.constant and (look.rises or _wrap(look))]
    by_name = [look for look in rising if look.header.has(CLOCK) or look.header.base.lower() in CLOCK]
    by_unit = [look for look in rising if look not in by_name and convert(look.header.unit).is_time]
    if OWN in columns:  # of others only those that say another time beyond doubt
        own = columns[OWN]
        steps = [(look, look.step * convert(_unit(look)[0] or "").factor) for look in by_name if look.header.unit]
        return [own, *(look for look, step in steps if abs(step - own.step) > 0.01 * own.step)]
    return by_name or by_unit


def _one_of(named: Sequence[Look]) -> Look | None:
    """The clock with the finest steps of several that show the same time in known units."""
    steps = []
    for look in named:
        unit, _ = _unit(look)
        if unit is None:
            return None
        mean = (look.finite[-1] - look.finite[0]) / max(len(look.finite) - 1, 1)  # jitter moves the middle step
        steps.append((look.step * convert(unit).factor, mean * convert(unit).factor))
    if all(max(each) > 1.01 * min(each) for each in zip(*steps, strict=True)):
        return None
    return of_source(max(named, key=lambda look: len(np.unique(look.finite))), named)


def _apart(look: Look, other: Look) -> str:
    return apart(look, other, *(convert(_unit(each)[0] or "s").factor for each in (look, other)))


def _by_numbers(columns: Mapping[str, Look], found: ClockGuess) -> None:
    """A column without a telling name that ticks."""
    spoken_for = INPUT | REFERENCE | OUTPUT | NEVER | ASIDE | COUNTERS
    ticking = [look for look in columns.values() if look.ticks and not look.header.has(spoken_for)]
    ticking = [look for look in ticking if not look.header.unit or convert(look.header.unit).is_time]
    if len(ticking) != 1:
        return
    look = ticking[0]
    if look.step == 1.0 and look.whole:
        found.unclear.append(
            f"column {look.name!r} counts by 1: samples, or a clock; give the sampling time with --ts, or name the "
            "clock with --time and --time-unit"
        )
        found.clock = Clock(column=look.name)
        found.remarks["clock.column"] = "NOT SURE: it may count samples"
        return
    found.why.append(f"column {look.name!r} rises in equal steps, as a clock does")
    describe(look, found)


def _unit(look: Look) -> tuple[str | None, str]:
    """The unit of a clock and why, or None and what is unclear."""
    if look.dated:
        return "s", "it holds dates or times of day"
    if apart := two_units(look):
        return None, f"{apart}; say which with --time {look.name!r} --time-unit, or as unit of [clock] in a mapping"
    if look.header.unit:
        if convert(look.header.unit).is_time:
            return look.header.unit, "its header says so"
        return None, f"column {look.name!r} may be the clock, but its unit {look.header.unit!r} is no unit of time"
    words = [UNIT_OF_CLOCK[word] for word in look.header.words if word in UNIT_OF_CLOCK]
    if text := written_unit(look):
        if is_time(text):
            return text, "its header says so"
        return None, (
            f"column {look.name!r} may be the clock, but {text!r} is no unit of time (s, ms, us, ns, min, h, day); say "
            f"which with --time {look.name!r} --time-unit, or as unit of [clock] in a mapping"
        )
    if words:
        return words[0], "its name says so"
    largest, step = float(np.abs(look.finite).max()), look.step
    for unit, size in {**UNITS, "ns": 1e-9}.items() if look.finite.min() > 0 and not _wrap(look) else ():
        if SINCE_1970[0] <= largest * size <= SINCE_1970[1] and step * size <= STEPS[1]:
            return unit, "its stamps count from 1970"
    usual = float(np.median(np.abs(look.finite)))  # a single wrong stamp says nothing of the unit
    latest = SINCE_1970[1]
    fits = [u for u, size in UNITS.items() if STEPS[0] <= step * size <= STEPS[1] and usual * size <= latest]
    if len(fits) == 1:
        return fits[0], (
            f"it names no unit, and its steps of {step:.6g} are plausible in {fits[0]} alone (a step from "
            f"{STEPS[0]:g} to {STEPS[1]:g} s)"
        )
    if not fits and look.whole and TICKS[0] <= usual <= TICKS[1]:
        return None, (
            f"column {look.name!r} has stamps near {usual:.3g}, as a clock of 100 ns has (FILETIME, ticks of .NET); "
            "give the sampling time with --ts, or write the stamps in seconds"
        )
    if any(first <= usual <= last for first, last in DAYS) and STEPS[0] <= step * DAY <= STEPS[1]:
        fits = [*(fits or UNITS), "day"]
    readings = " or ".join(f"{step * {**UNITS, 'day': DAY}[u]:.6g} s (if in {u})" for u in fits or UNITS)
    return None, (
        f"column {look.name!r} names no unit, and its steps of {step:.6g} may be {readings}; say which with "
        "--time-unit, or as unit of [clock] in a mapping"
    )


def _wrap(look: Look) -> Bits:
    """Bits of the counter if every fall of the numbers is one of its wraps, else 0."""
    x = look.finite
    if len(x) < 3 or not look.whole:
        return 0
    steps = np.diff(x)
    falls = steps[steps < 0]
    if not len(falls) or len(falls) > 0.1 * len(steps):
        return 0
    for bits in WRAPS:
        period = 2.0**bits
        if within_counter(x, bits).all() and np.all((falls + period > 0) & (falls + period <= NEAR_WRAP * look.step)):
            return bits
    return 0

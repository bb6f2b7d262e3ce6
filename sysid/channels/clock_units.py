"""What the stamps of a clock are: their unit, by the header, the name or their size, and the bits of a counter."""

from dataclasses import dataclass

import numpy as np

from sysid.base.time_words import ALONE, ANYWHERE, DIGITS, UNSURE, as_whole
from sysid.channels.contradictions import is_time, two_units, written_unit
from sysid.channels.looks import Look
from sysid.channels.mapping import Bits
from sysid.channels.stamps import within_counter
from sysid.channels.units import convert, seconds

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
OF_1970 = {**UNITS, "ns": 1e-9}
STEPS = (2e-4, 10.0)  # [s] between samples of an actuator's log; a unit that gives another step is implausible
SINCE_1970 = (1e9, 4e9)  # [s] stamps of the years 2001 to 2096
DAY = 86400.0  # [s]
DAYS = ((2e4, 8e4), (7e5, 8e5))  # serial dates of spreadsheets and of MATLAB, of about our years
TICKS = (1e17, 1e18)  # of 100 ns since the year 1601 or 1, today
WRAPS: tuple[Bits, ...] = (16, 32)
NEAR_WRAP = 20  # steps: a counter that starts again was at most so far from its end


@dataclass(frozen=True)
class ClockUnit:
    """The unit of a clock and why; None and what is unclear.

    `stated` is False where the file names no unit, and the step alone speaks for this one.
    """

    unit: str | None
    why: str
    stated: bool = True


def unit_of_clock(look: Look) -> ClockUnit:
    """The unit of a clock: what the file says, as far as it does not contradict itself; else what is plausible."""
    if look.dated:
        return ClockUnit("s", "it holds dates or times of day")
    if look.timed:
        return ClockUnit("s", "it holds times by its type in the file")
    if no_count := digits_of_a_day(look.name):
        return ClockUnit(None, no_count)
    say = f"say which with --time {look.name!r} --time-unit, or as unit of [clock] in a mapping"
    if apart := two_units(look):
        return ClockUnit(None, f"{apart}; {say}")
    named = _named(look, say)
    if named is None:
        return _by_size(look)
    if named.unit is not None and (other := _since_1970(look, named.unit)):
        return ClockUnit(None, f"{other}; {say}")
    return named


def digits_of_a_day(name: str) -> str:
    """A sentence if a name says that the numbers are digits of times of day, as hhmmss does; else nothing."""
    word = next((word for word in name.lower().replace("-", "_").split("_") if DIGITS.fullmatch(word)), "")
    return word and (
        f"column {name!r} holds times of day written as one number ({word}), which are no count of a unit; write them "
        "as 09:00:00, or give the sampling time with --ts"
    )


def _named(look: Look, say: str) -> ClockUnit | None:
    """The unit that the header or a word of the name says; None if they say none."""
    clock = f"column {look.name!r} may be the clock"
    if look.header.unit:
        if convert(look.header.unit).is_time:
            return ClockUnit(look.header.unit, "its header says so")
        return ClockUnit(None, f"{clock}, but its unit {look.header.unit!r} is no unit of time")
    if text := written_unit(look.name):
        if is_time(text):
            return ClockUnit(text, "its header says so")
        return ClockUnit(None, f"{clock}, but {text!r} is no unit of time (s, ms, us, ns, min, h, day); {say}")
    units = sorted({ANYWHERE[word] for word in look.header.words if word in ANYWHERE})
    if len(units) > 1:
        return ClockUnit(None, f"column {look.name!r} has two units, {units[0]} and {units[1]}; {say}")
    if units:
        return ClockUnit(units[0], "its name says so")
    word = as_whole(look.header.base)
    if word in UNSURE:
        return ClockUnit(None, f"{clock}, in {ALONE[word]} by its last letter or in another unit; {say}")
    return ClockUnit((ANYWHERE | ALONE)[word], "its name says so") if word else None


def _since_1970(look: Look, unit: str) -> str:
    """A sentence if stamps are beyond doubt another unit since 1970 than the named one; else nothing.

    In the named unit they are later than 2096, or step faster than an actuator's log and do not count from 1970.
    """
    x, own = look.finite, seconds(unit)
    low, high, step = float(x.min()), float(x.max()), look.step
    if low <= 0 or not step or (low * own >= SINCE_1970[0] and high * own <= SINCE_1970[1]):
        return ""
    for other, size in OF_1970.items():
        counts = low * size >= SINCE_1970[0] and high * size <= SINCE_1970[1] and step * size <= STEPS[1]
        fine = step * own < STEPS[0] <= step * size and (size < 1.0 or not look.whole)
        if counts and (fine or high * own > SINCE_1970[1]):
            return f"column {look.name!r} names {unit}, and its stamps near {high:.6g} count from 1970 in {other}"
    return ""


def _by_size(look: Look) -> ClockUnit:
    """The only unit in which stamps count from 1970, or in which their steps are those of an actuator's log."""
    largest, step = float(np.abs(look.finite).max()), look.step
    for unit, size in OF_1970.items() if look.finite.min() > 0 and not counter_bits(look) else ():
        if SINCE_1970[0] <= largest * size <= SINCE_1970[1] and step * size <= STEPS[1]:
            return ClockUnit(unit, "its stamps count from 1970")
    usual = float(np.median(np.abs(look.finite)))  # a single wrong stamp says nothing of the unit
    latest = SINCE_1970[1]
    fits = [u for u, size in UNITS.items() if STEPS[0] <= step * size <= STEPS[1] and usual * size <= latest]
    if len(fits) == 1:
        return ClockUnit(
            fits[0],
            f"it names no unit, and its steps of {step:.6g} are plausible in {fits[0]} alone (a step from "
            f"{STEPS[0]:g} to {STEPS[1]:g} s)",
            stated=False,
        )
    if not fits and look.whole and TICKS[0] <= usual <= TICKS[1]:
        return ClockUnit(
            None,
            f"column {look.name!r} has stamps near {usual:.3g}, as a clock of 100 ns has (FILETIME, ticks of .NET); "
            "give the sampling time with --ts, or write the stamps in seconds",
        )
    if any(first <= usual <= last for first, last in DAYS) and STEPS[0] <= step * DAY <= STEPS[1]:
        fits = [*(fits or UNITS), "day"]
    readings = " or ".join(f"{step * {**UNITS, 'day': DAY}[u]:.6g} s (if in {u})" for u in fits or UNITS)
    return ClockUnit(
        None,
        f"column {look.name!r} names no unit, and its steps of {step:.6g} may be {readings}; say which with "
        "--time-unit, or as unit of [clock] in a mapping",
        stated=False,
    )


def counter_bits(look: Look) -> Bits:
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

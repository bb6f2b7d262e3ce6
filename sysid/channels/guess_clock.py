"""Which column is the clock, in what unit, and whether it wrapped: by name, by unit, then by the numbers alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.clock_units import counter_bits, digits_of_a_day, unit_of_clock
from sysid.channels.contradictions import is_time, written_unit
from sysid.channels.looks import Look
from sysid.channels.mapping import Clock
from sysid.channels.names import ASIDE, CLOCK, COUNTERS, INPUT, NEVER, OUTPUT, REFERENCE
from sysid.channels.same_time import apart, of_source
from sysid.channels.units import convert

OWN = "time_s"  # in the logs that this program writes


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
    same: tuple[str, ...] = ()  # columns that show the same time, and so are no signals


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
        found.same = tuple(each.name for each in named)
        found.why += [
            f"column {look.name!r} is the clock; {each.name!r} shows the same time{_apart(look, each)}"
            for each in named
            if each is not look
        ]
    describe(look, found)
    return found


def describe(look: Look, found: ClockGuess) -> None:
    """Puts the clock of this column into `found`: its unit, why, and whether it wrapped."""
    said = unit_of_clock(look)
    if said.unit is None:
        found.unclear.append(said.why)
        found.remarks["clock.unit"] = "NOT SURE"
    else:
        found.why.append(f"column {look.name!r} is the clock, in {said.unit}: {said.why}")
    wrap = counter_bits(look)
    if wrap:
        found.why.append(f"the clock is a counter of {wrap} bits: it falls by almost 2^{wrap}")
    found.clock = Clock(column=look.name, unit=said.unit or "s", wrap=wrap)


def clock_of(look: Look, unit: str | None = None) -> tuple[Clock, list[str]]:
    """The clock of a named column, and why it is read so. Raises InputError if its unit is unclear."""
    if unit is not None:
        if no_count := "" if look.dated or look.timed else digits_of_a_day(look.name):
            raise InputError(no_count)
        own, given = (
            look.header.unit or written_unit(look.name),
            Clock(column=look.name, unit=unit, wrap=counter_bits(look)),
        )
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
    rising = [look for look in columns.values() if not look.constant and (look.rises or counter_bits(look))]
    by_name = [look for look in rising if look.header.has(CLOCK) or look.header.base.lower() in CLOCK]
    by_name = [look for look in by_name if not _measures(look)] or by_name  # T [degC] of a motor that warms up
    by_unit = [look for look in rising if look not in by_name and convert(look.header.unit).is_time]
    if OWN in columns:  # of others only those that say another time beyond doubt
        own = columns[OWN]
        steps = [
            (look, look.step * convert(unit_of_clock(look).unit or "").factor) for look in by_name if look.header.unit
        ]
        return [own, *(look for look, step in steps if abs(step - own.step) > 0.01 * own.step)]
    return by_name or by_unit


def _measures(look: Look) -> bool:
    """Whether a column names a unit that is none of time, or is called T, as temperatures, torques and periods are."""
    unit = look.header.unit or written_unit(look.name)
    if look.header.words & CLOCK == {"t"} and "t" not in look.header.base:
        return True
    return bool(unit) and not convert(unit).is_time


def _one_of(named: Sequence[Look]) -> Look | None:
    """The clock with the finest steps of several that show the same time in known units."""
    steps = []
    for look in named:
        unit = unit_of_clock(look).unit
        if unit is None:
            return None
        mean = (look.finite[-1] - look.finite[0]) / max(len(look.finite) - 1, 1)  # jitter moves the middle step
        steps.append((look.step * convert(unit).factor, mean * convert(unit).factor))
    if all(max(each) > 1.01 * min(each) for each in zip(*steps, strict=True)):
        return None
    return of_source(max(named, key=lambda look: len(np.unique(look.finite))), named)


def _apart(look: Look, other: Look) -> str:
    return apart(look, other, *(convert(unit_of_clock(each).unit or "s").factor for each in (look, other)))


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

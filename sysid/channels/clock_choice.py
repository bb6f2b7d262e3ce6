"""Which column is the clock: by name, by unit, then by the numbers alone."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.clock import (
    CLOCK_WORDS,
    clock_distance,
    counter_bits,
    digits_of_a_day,
    evenest_clock,
    is_named_clock,
    unit_of_clock,
)
from sysid.channels.column import Column, unit_in_brackets
from sysid.channels.conversion import convert, is_time
from sysid.channels.mapping import Clock
from sysid.channels.roles import AUXILIARY, COUNTERS, FREQUENCY, INPUT, NEVER, OUTPUT, REFERENCE, Columns, role_by_name

CLOCK_OF_LOG = "time_s"  # of the logs that this program writes


@dataclass
class ClockChoice:
    """The clock, None if there is none; why; what is unclear; and remarks on entries of the mapping.

    `unused` is a column of stamps that are not used, `same` are columns that show the same time, and so are no signals.
    A clock that stands in two columns would be described here too.
    """

    clock: Clock | None = None
    why: list[str] = field(default_factory=list)
    unclear: list[str] = field(default_factory=list)
    remarks: dict[str, str] = field(default_factory=dict)
    unused: str = ""
    same: tuple[str, ...] = ()

    def describe(self, column: Column) -> None:
        """Takes the clock of this column: its unit, why, and whether it wrapped."""
        reading = unit_of_clock(column)
        if reading.unit is None:
            self.unclear.append(reading.why)
            self.remarks["clock.unit"] = "NOT SURE"
        else:
            self.why.append(f"column {column.name!r} is the clock, in {reading.unit}: {reading.why}")
        bits = counter_bits(column)
        if bits:
            self.why.append(f"the clock is a counter of {bits} bits: it falls by almost 2^{bits}")
        self.clock = Clock(column=column.name, unit=reading.unit or "s", period=2.0**bits if bits else None)


def choose_clock(columns: Columns) -> ClockChoice:
    """The clock among the columns of a table."""
    choice = ClockChoice()
    candidates = _named_clocks(columns)
    if not candidates:
        _choose_clock_by_numbers(columns, choice)
        return choice
    clock = candidates[0]
    if len(candidates) > 1:
        finest = _finest_clock(candidates)
        if finest is None:
            names = ", ".join(repr(column.name) for column in candidates)
            choice.unclear.append(
                f"{names} may each be the clock and do not agree; name one with --time, or where each signal has its "
                "own, name it as clock of [[input]] and of [[output]] in a mapping"
            )
            choice.remarks["clock.column"] = f"not sure: one of {names}"
            choice.clock = Clock(column=clock.name)
            return choice
        clock = finest
        choice.same = tuple(column.name for column in candidates)
        choice.why += [
            f"column {clock.name!r} is the clock; {other.name!r} shows the same time{clock_distance(clock, other)}"
            for other in candidates
            if other is not clock
        ]
    choice.describe(clock)
    return choice


def clock_of_column(column: Column, unit: str | None = None) -> ClockChoice:
    """The clock of a named column, and why it is read so. Raises InputError if its unit is unclear."""
    choice = ClockChoice()
    if unit is not None:
        if sentence := "" if column.dated or column.timed else digits_of_a_day(column.name):
            raise InputError(sentence)
        bits = counter_bits(column)
        choice.clock = Clock(column=column.name, unit=unit, period=2.0**bits if bits else None)
        header_unit = column.header.unit or unit_in_brackets(column.name)
        if is_time(header_unit) and convert(header_unit).factor != convert(unit).factor:
            choice.why.append(
                f"column {column.name!r} is the clock, in {unit} as given; its header names {header_unit}"
            )
        return choice
    choice.describe(column)
    if choice.unclear:
        raise InputError(choice.unclear[0])
    return choice


def _named_clocks(columns: Columns) -> list[Column]:
    """Columns that are clocks by name or by unit, and rise."""
    rising = [c for c in columns.values() if not c.constant and (c.rising or counter_bits(c))]
    by_name = [column for column in rising if is_named_clock(column.header)]
    by_name = [column for column in by_name if not is_measurement(column)] or by_name
    by_unit = [column for column in rising if column not in by_name and is_time(column.header.unit)]
    if CLOCK_OF_LOG in columns:  # of others only those that say another time beyond doubt
        clock = columns[CLOCK_OF_LOG]
        steps = [(c, c.step * convert(unit_of_clock(c).unit or "").factor) for c in by_name if c.header.unit]
        return [clock, *(column for column, step in steps if abs(step - clock.step) > 0.01 * clock.step)]
    return by_name or by_unit


def is_measurement(column: Column) -> bool:
    """Whether a column names a unit that is none of time, or is called T, as temperatures, torques and periods are.

    T [degC] of a motor that warms up rises too.
    """
    unit = column.header.unit or unit_in_brackets(column.name)
    if column.header.words & CLOCK_WORDS == {"t"} and "t" not in column.header.base:
        return True
    return bool(unit) and not is_time(unit)


def _finest_clock(candidates: Sequence[Column]) -> Column | None:
    """The clock with the finest steps of several that show the same time in known units."""
    steps = []
    for column in candidates:
        unit = unit_of_clock(column).unit
        if unit is None:
            return None
        x, factor = column.finite, convert(unit).factor
        mean = (x[-1] - x[0]) / max(len(x) - 1, 1)  # jitter moves the middle step
        steps.append((column.step * factor, mean * factor))
    if all(max(each) > 1.01 * min(each) for each in zip(*steps, strict=True)):
        return None
    return evenest_clock(max(candidates, key=lambda column: len(np.unique(column.finite))), candidates)


def _choose_clock_by_numbers(columns: Columns, choice: ClockChoice) -> None:
    """Puts the one column without a telling name that ticks into `choice`."""
    signals = INPUT | REFERENCE | OUTPUT | NEVER | AUXILIARY | COUNTERS | FREQUENCY
    ticking = [c for c in columns.values() if c.ticking and not c.header.has(signals)]
    ticking = [column for column in ticking if not column.header.unit or is_time(column.header.unit)]
    if len(ticking) != 1:
        return
    column = ticking[0]
    if column.step == 1.0 and column.integer:
        choice.unclear.append(
            f"column {column.name!r} counts by 1: samples, or a clock; give the sampling time with --ts, or name the "
            f"clock with --time {column.name!r} --time-unit s (or another)"
        )
        choice.clock = Clock(column=column.name)
        choice.remarks["clock.column"] = "NOT SURE: it may count samples"
        return
    choice.why.append(f"column {column.name!r} rises in equal steps, as a clock does")
    choice.describe(column)


def uneven_time(columns: Columns, named: Sequence[str | None]) -> str:
    """One of two columns that rises in every row and has no telling name: uneven stamps, and no input by guess."""
    if len(columns) != 2 or any(named):
        return ""
    rising = [c.name for c in columns.values() if np.all(np.diff(c.values) > 0) and role_by_name(c) in ("", "none")]
    return rising[0] if len(rising) == 1 else ""

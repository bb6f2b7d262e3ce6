"""What a file says twice and differently: its sampling time beside its clock, a unit beside the name of its column."""

import re
from collections.abc import Mapping

import numpy as np

from sysid.base.time_words import ANYWHERE
from sysid.channels.looks import Look
from sysid.channels.mapping import Clock
from sysid.channels.names import CLOCK
from sysid.channels.units import convert, seconds
from sysid.data.table import Table
from sysid.formats import unit_in

APART = 0.1  # of a step: lost samples, a rounded clock and a rig that is slower than it was told stay below
UNIT_OF_TS = ("ts_unit", "tsunit", "ts_units", "unit", "units", "time_unit", "timeunit")
SECONDS = ("", "s", "sec", "secs", "second", "seconds")
PLAUSIBLE = (1e-9, 1e8)  # [s] of a sampling time that a file states


def stated(table: Table) -> float | None:
    """The sampling time [s] in what the writer said of the record; None if there is none."""
    value = table.meta.get("Ts")
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        found = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return None
    return found if 0 < found < np.inf else None


def why_not_stated(Ts: float, table: Table, columns: Mapping[str, Look]) -> str:
    """Why the sampling time [s] of the header is not taken, where no column is a clock; else nothing."""
    said = f"the header says that the sampling time Ts is {Ts:g} s"
    if not PLAUSIBLE[0] <= Ts <= PLAUSIBLE[1]:
        return f"{said}, which no rig has; give the right one with --ts, or correct the header"
    for name, text in table.meta.items():
        if name.lower() in UNIT_OF_TS and isinstance(text, str) and text.strip().lower() not in SECONDS:
            return f"{said.removesuffix(' s')} and {name} {text[:40]!r}; give the sampling time in seconds with --ts"
    for look in columns.values():
        if (look.header.has(CLOCK) or look.header.base.lower() in CLOCK) and len(look.finite) > 1:
            falls = np.flatnonzero(np.diff(look.values) < 0)
            rows = table.rows[table.names.index(look.name)]
            where = f" (it falls in {table.place} {rows[int(falls[0]) + 1]})" if len(falls) else " in any row"
            return (
                f"{said}, and column {look.name!r}, a clock by its name, does not rise{where}; give the sampling time "
                "with --ts, or correct the column"
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


def commented(text: str) -> tuple[float, ...]:
    """The sampling times [s] that a comment such as `Ts = 0.01`, `fs: 100` or `sampling rate: 100 Hz` may mean."""
    for pattern, of_time in ((TIME, True), (RATE, False)):
        found = pattern.fullmatch(text.strip().rstrip(";,."))
        if found is None:
            continue
        unit = convert(found[2] or ("s" if of_time else "Hz"))
        if not unit.known or unit.unit != ("s" if of_time else "1/s"):
            return ()
        written = [found[1].replace(",", ".")]
        written += [re.sub("[.,]", "", found[1])] if THOUSANDS_OF.fullmatch(found[1]) else []
        values = [value for each in written if 0.0 < (value := float(each)) < np.inf]
        times = [value * unit.factor if of_time else 1.0 / (value * unit.factor) for value in values]
        meant = [each * power for each in times for power in (POWERS if not found[2] else POWERS[:1])]
        return tuple(each for each in meant if POSSIBLE[0] <= each <= POSSIBLE[1])
    return ()


def other_than_stated(table: Table, clock: Clock, values: np.ndarray) -> str:
    """A sentence if the header's Ts is not the step of the clock's `values` (n,); else nothing."""
    Ts = stated(table)
    if Ts is None:
        return ""
    return _other(f"the header says that the sampling time Ts is {Ts:g} s", (Ts,), clock, values)


def other_than_commented(table: Table, clock: Clock, values: np.ndarray) -> list[str]:
    """Sentences on comments above a table that state another step than that of the clock's `values` (n,)."""
    said = [(f"a comment says {text[:40]!r}", times) for text in table.comments if (times := commented(text))]
    found = [other for words, times in said if (other := _other(words, times, clock, values))]
    return [f"{other}: the column is used" for other in found]


def _other(said: str, times: tuple[float, ...], clock: Clock, values: np.ndarray) -> str:
    """What is said, and the step of the clock, where none of `times` [s] is that step; else nothing.

    The middle step, the mean of those that rise and the mean of all may be meant, where samples were lost or stamps
    are rounded.
    """
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    rising = steps[steps > 0]
    if not len(rising):
        return ""
    factor = seconds(clock.unit)
    own = [float(step) * factor for step in (np.median(rising), rising.mean(), steps[steps >= 0].mean())]
    if any(abs(a - b) <= APART * max(a, b) for a in own for b in times):
        return ""
    return f"{said}, and column {clock.column!r} steps by {own[0]:.6g} s"


def two_units(look: Look) -> str:
    """A sentence if a column's name has two units of one quantity, or another than the row below; else nothing.

    mV beside V and ms beside s are a factor of 1000; V beside deg is a pot whose volts became an angle.
    """
    if look.dated or look.timed:  # the type of the values settles it
        return ""
    words = sorted(ANYWHERE[word] for word in look.header.words if word in ANYWHERE)
    named = [unit_in(look.name), unit_in(look.header.base), look.header.unit, *(words if look.header.unit else ())]
    units = list(dict.fromkeys(text for text in named if text))
    found = [(text, each) for text in units if (each := convert(text)).known]
    for text, each in found[1:]:
        first, one = found[0]
        if each.unit == one.unit and abs(each.factor - one.factor) > 1e-9 * one.factor:
            return f"column {look.name!r} has two units, {first} and {text}"
    return ""


RELATIVE = {"relative", "rel", "elapsed", "absolute", "abs", "raw", "local", "utc", "gmt", "start", "-", "1", ""}
_WRITTEN = (
    re.compile(r".+?\s*[\[({]\s*([^\[\](){}]*?)\s*[\])}]\s*"),
    re.compile(r"\s*(?:t|time|zeit)\s*/\s*(\S+)\s*", re.IGNORECASE),
)


def written_unit(name: str) -> str:
    """What stands where the name of a clock has its unit: the unit if it is one of time in other letters (MS, Min)."""
    for form in _WRITTEN:
        match = form.fullmatch(name)
        if match and match[1].lower() not in RELATIVE and not match[1].isdigit():
            spelled = (text for text in (match[1], match[1].lower(), match[1].rstrip(".")) if is_time(text))
            return next(spelled, match[1])
    return ""


def is_time(unit: str) -> bool:
    """Whether a text is a unit of time."""
    found = convert(unit)
    return found.known and found.is_time

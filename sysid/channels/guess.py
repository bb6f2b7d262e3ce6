"""A mapping from what a table shows, with the reason for each entry and what remains unclear."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.limits import SECONDS as LONGEST
from sysid.channels.complaints import listed
from sysid.channels.contradictions import (
    other_than_commented,
    other_than_stated,
    stated,
    two_units,
    why_not_stated,
    written_unit,
)
from sysid.channels.guess_clock import ClockGuess, clock_of, guess_clock
from sysid.channels.lacking import lacking
from sysid.channels.looks import Look, looks
from sysid.channels.mapping import SHORTEST, Channel, ChannelMap, Clock
from sysid.channels.names import (
    ASIDE,
    BEFORE,
    BEHIND,
    COUNTERS,
    INPUT,
    INPUT_TOO,
    NEVER,
    OUTPUT,
    OUTPUT_TOO,
    REFERENCE,
    header,
    is_numbered,
    label,
    unit_text,
)
from sysid.channels.units import COUNTS, convert, seconds
from sysid.channels.unread import unread
from sysid.channels.values import numbers, soft_numbers
from sysid.data.table import Table
from sysid.formats import read_table

OWN = ("voltage_V", "angle_rad")  # input and output of the logs that this program writes
PLAIN_VOLTS = {"voltage", "volt", "volts"}  # of which quantity, another word says: pot_voltage
STRONG = {"input": {"u", "input"}, "output": {"y", "output"}}
LOST = 1.75  # of the middle step of a clock: a longer one leaves samples out
MANY = 6  # names in a sentence
NO_CLOCK = (
    "no sampling time is given; give it with --ts SECONDS or name a time column with --time (no column is a clock)"
)


@dataclass(frozen=True)
class Guess:
    """A mapping; `why` are sentences for its entries, `unclear` those that a person has to decide.

    `remarks` by entry ("clock.unit") stand beside the entry in the file.
    """

    mapping: ChannelMap
    why: tuple[str, ...]
    unclear: tuple[str, ...] = ()
    remarks: Mapping[str, str] = field(default_factory=dict)

    def sure(self, table: Table) -> ChannelMap:
        """The mapping; raises InputError with the first thing that is unclear."""
        if self.unclear:
            raise InputError(f"{table.path}: {self.unclear[0]}")
        return self.mapping


@dataclass(frozen=True)
class Given:
    """What a person has said already: columns, the unit of the clock, the sampling time [s].

    `more` are the further columns of a role that has several.
    """

    input: str | None = None
    output: str | None = None
    time: str | None = None
    time_unit: str | None = None
    Ts: float | None = None
    more: Mapping[str, tuple[str, ...]] | None = None


@checked
def guess(table: Table | str | os.PathLike[str], given: Given = Given()) -> Guess:
    """Clock, input and output of a table, or of the file at this path, by names, units and numbers, as far as they are
    not `given`.

    It never picks one of two readings that are equally plausible: it says what is unclear. Raises InputError for a
    table without columns of numbers, for a given column that it lacks, and for a file that cannot be read.
    """
    if not isinstance(table, Table):
        table = read_table(table)
    columns = looks(table)
    if not columns:
        why_not = unread(table, columns) or next(iter(table.undated.values()), "")
        found = f"no column holds numbers; found {listed(table.names) or 'none'}"
        raise InputError(f"{table.path}: {found}{f': {why_not}' if why_not else ''}")
    more = given.more or {}
    for name in (given.input, given.output, given.time, *(name for names in more.values() for name in names)):
        if name is not None and name not in columns:
            numbers(table, name)  # which says what it lacks
    timed = _clock(table, columns, given)
    why, unclear, remarks = timed.why, timed.unclear, timed.remarks
    clock = timed.clock or Clock()
    times = (clock.column, timed.aside, *timed.same)
    rest = {name: look for name, look in columns.items() if name not in times and not look.dated}
    if given.input is None and given.output is None:
        sure = not unclear
        picked = _pair(table, rest, why, unclear)
        if sure and not unclear:
            unclear += lacking(table, picked, columns, rest)
        _say_text(table, columns, picked, unclear)
    else:
        picked = {role: columns.get(getattr(given, role) or "") for role in ("input", "output")}
        unclear += lacking(table, picked, columns, rest)
    channels: dict[str, list[Channel]] = {}
    for role, first in picked.items():
        channels[role] = [] if first is not None else [Channel(column="")]
        if first is None:
            remarks[f"{role}.column"] = f"CHOOSE one of {', '.join(rest)}"
        for look in (first, *(columns[name] for name in more.get(role, ()))):
            if look is not None:
                unit = unit_text(look.header)
                name = label(Channel(column=look.name), role, unit)
                channels[role].append(Channel(column=look.name, unit=unit, name=name))
                _say_unit(role, look, unit, why, remarks)
                if apart := two_units(look):
                    unclear.append(f"{apart}; say which as unit of [[{role}]] in a mapping")
    mapping = ChannelMap(clock=clock, input=tuple(channels["input"]), output=tuple(channels["output"]))
    return Guess(mapping, tuple(why), tuple(unclear), remarks)


def _clock(table: Table, columns: Mapping[str, Look], given: Given) -> ClockGuess:
    if given.time is not None:
        try:
            clock, why = clock_of(columns[given.time], given.time_unit)
        except InputError as error:
            raise InputError(f"{table.path}: {error}") from None
        other = other_than_stated(table, clock, columns[given.time].values)
        return ClockGuess(clock, [*why, f"{other}: the column is used, as given"] if other else why)
    named = (given.input, given.output)  # no clock, whatever they look like
    timed = guess_clock({name: look for name, look in columns.items() if not look.dated and name not in named})
    if timed.clock is None and stated(table) is None:  # dates are often coarser than the samples
        timed = guess_clock({name: look for name, look in columns.items() if look.dated})
    if given.Ts is not None:
        note = _other_step(timed, columns, given.Ts) if not timed.unclear else []
        aside = timed.clock.column if timed.clock is not None and len(columns) > 2 else ""
        return ClockGuess(Clock(Ts=given.Ts), note, aside=aside)
    if timed.clock is None and (Ts := stated(table)) is not None:
        unclear = [why_not] if (why_not := why_not_stated(Ts, table, columns)) else []
        known = Clock(Ts=Ts) if SHORTEST <= Ts <= LONGEST else None  # no clock has it, which `unclear` says
        return ClockGuess(known, [f"the sampling time is {Ts:g} s: the file says so"], unclear)
    if timed.clock is not None and not timed.unclear:
        other = other_than_stated(table, timed.clock, columns[timed.clock.column].values)
        timed.why += other_than_commented(table, timed.clock, columns[timed.clock.column].values)
        timed.unclear += [f"{other}; say which with --ts, or with --time {timed.clock.column!r}"] if other else []
    if timed.clock is None:
        timed.unclear.append(next(iter(table.undated.values()), "") or unread(table, columns) or NO_CLOCK)
        timed.remarks["clock.Ts"] = "NEEDED"
    return timed


def _other_step(timed: ClockGuess, columns: Mapping[str, Look], Ts: float) -> list[str]:
    """A word about a clock that does not say what was given."""
    if timed.clock is None:
        return []
    look = columns[timed.clock.column]
    factor = seconds(timed.clock.unit)
    said = []
    if abs(look.step * factor - Ts) > 0.01 * Ts:
        said.append(f"the sampling time is {Ts:g} s as given; column {look.name!r} steps by {look.step * factor:.6g} s")
    steps = np.diff(look.finite)
    (jumps,) = np.nonzero((steps > LOST * look.step) | (steps < 0.0))
    if look.step > 0.0 and len(jumps):
        said.append(
            f"the rows are taken as uniform, as the sampling time is given; column {look.name!r} has {len(jumps)} "
            f"other step(s), the first of {steps[jumps[0]] * factor:.6g} s: leave the sampling time out to have them "
            "looked after"
        )
    return said


def _say_text(table: Table, columns: Mapping[str, Look], picked: Mapping[str, Look | None], unclear: list[str]) -> None:
    """A column called u or y that holds no numbers is not passed over for another one."""
    for name, cells in zip(table.names, table.columns, strict=True):
        words = header(name, table.units.get(name, "")).words
        for role, look in picked.items():
            strong = look is not None and look.header.words <= STRONG[role]
            if name not in columns and words and words <= STRONG[role] and not strong:
                wrong = np.flatnonzero(np.isnan(soft_numbers(table, name)))
                first = str(cells[int(wrong[0])]) if len(wrong) else ""
                said = f"column {name!r} is the {role} by its name, but most of its cells are no numbers"
                why = unread(table, columns, only=name) or f"the first is {first[:40]!r}; correct them"
                unclear.insert(0, f"{said}: {why}, or name another with --{role}")


def _pair(table: Table, rest: Mapping[str, Look], why: list[str], unclear: list[str]) -> dict[str, Look | None]:
    """Input and output among the columns that are not the clock; None where it is unclear."""
    if OWN[0] in rest and OWN[1] in rest:
        why.append(f"read column {OWN[0]!r} as the input and {OWN[1]!r} as the output: a log of this program")
        return {"input": rest[OWN[0]], "output": rest[OWN[1]]}
    said = len(why)
    found = {role: _one(role, _candidates(rest, role), why, unclear, rest) for role in ("input", "output")}
    if len(table.names) == 2 and len(rest) == 2:
        first, second = rest.values()
        turned = found["input"] is second or found["output"] is first
        if not unclear and found["input"] is found["output"] is None:
            turned = _is_turned(first, second, unclear)
        if not unclear and (found["input"] is None or found["input"] is not found["output"]):
            pair = (second, first) if turned else (first, second)
            why[said:] = [f"read column {pair[0].name!r} as the input and {pair[1].name!r} as the output"]
            return dict(zip(("input", "output"), pair, strict=True))
    if unclear:
        return {"input": None, "output": None} | {role: look for role, look in found.items() if look}
    for role, other in (("input", "output"), ("output", "input")):
        if found[role] is None and found[other] is not None:
            found[role] = _left_over(role, found[other], rest, why)
    return found


def _is_turned(first: Look, second: Look, unclear: list[str]) -> bool:
    """Whether two columns whose names are no usual ones stand as output, input; what is a toss-up is unclear."""
    into, out = ([look.header.has(words) for look in (first, second)] for words in (INPUT_TOO, OUTPUT_TOO))
    votes = (out[0] - into[0]) - (out[1] - into[1])
    if votes == 0 and not (is_numbered(first.name) and is_numbered(second.name)):
        unclear.append(
            f"the names {first.name!r} and {second.name!r} do not say which is the input; name one with --input and "
            "one with --output"
        )
    return votes > 0


def _candidates(rest: Mapping[str, Look], role: str) -> list[Look]:
    """Columns whose names say the role; without one, columns whose units say it."""
    moving = [look for look in rest.values() if not look.constant] or list(rest.values())
    named = [look for look in moving if _role(look) == role]
    strong = [look for look in named if look.header.words <= STRONG[role] and look.header.words]
    if len(strong) == 1 and not any(look.header.has(REFERENCE) for look in named):
        return strong
    if named:
        return named
    free = [look for look in moving if _role(look) == "" and look.header.unit]
    units = ("V", "1") if role == "input" else ("rad",)
    return [look for look in free if convert(look.header.unit).unit in units]


def _role(look: Look) -> str:
    """What the words of the name say: input, output, both, none of them, or nothing."""
    head = look.header
    if head.has(NEVER) or head.base.lower() in COUNTERS:
        return "none"
    to, of = head.has(INPUT | REFERENCE), head.has(OUTPUT) and not (head.words & OUTPUT == {"q"} and "Q" in head.base)
    if (of and head.has(BEFORE)) or (to and head.has(BEHIND)):
        return "both"
    if head.has(REFERENCE):
        return "input"
    if to and of:
        return "output" if head.words & INPUT <= PLAIN_VOLTS else "both"
    if head.has(ASIDE) and not head.has(STRONG["input"] | STRONG["output"]):
        return "none"
    return "input" if to else "output" if of else ""


def _one(role: str, found: list[Look], why: list[str], unclear: list[str], rest: Mapping[str, Look]) -> Look | None:
    """The one candidate; None if there is none or several."""
    both = [look for look in rest.values() if _role(look) == "both"]
    if both:
        unclear.append(
            f"the name {both[0].name!r} fits an input and an output; name the columns with --input and --output"
        )
        return None
    if role == "input" and len(found) > 1:
        supplies = [look for look in found if look.barely_varies and not look.header.has(REFERENCE)]
        if supplies and len(supplies) < len(found):
            names = " and ".join(repr(look.name) for look in supplies)
            why.append(f"{names} barely varies, so it is taken for a supply and not for the input")
            found = [look for look in found if look not in supplies]
    if len(found) > 1:
        names = ", ".join(repr(look.name) for look in found[:MANY])
        unclear.append(f"columns {names} may each be the {role}; name one with --{role}")
        return None
    if not found:
        return None
    look = found[0]
    by = "name" if _role(look) == role else "unit"
    what = ", a reference (the record of a servo)" if role == "input" and look.header.has(REFERENCE) else ""
    why.append(f"column {look.name!r} is the {role}{what}: its {by} says so")
    return look


def _left_over(role: str, taken: Look | None, rest: Mapping[str, Look], why: list[str]) -> Look | None:
    """The only other column that moves, if its name does not speak against the role."""
    others = [look for look in rest.values() if look is not taken and not look.constant]
    if len(others) != 1 or _role(others[0]) == "none" or _role(others[0]) not in ("", role):
        return None
    why.append(f"column {others[0].name!r} is the {role}: it is the only other one")
    return others[0]


def _say_unit(role: str, look: Look, unit: str, why: list[str], remarks: dict[str, str]) -> None:
    found = convert(unit)
    entry = f"unit of [[{role}]] in a mapping"
    if unit == "":
        text = written_unit(look.name)
        named = f"names {text!r}, which is no known unit" if text else "names no unit"
        why.append(f"column {look.name!r} {named}: its numbers stay as they are; set {entry} if you know it")
        remarks[f"{role}.unit"] = "not known: set it"
    elif unit == COUNTS:
        why.append(f"column {look.name!r} holds counts: its numbers stay as they are; set adc or scale of [[{role}]]")
    elif not found.known:
        why.append(f"column {look.name!r} has the unknown unit {unit!r}: its numbers stay as they are")
        remarks[f"{role}.unit"] = "not known: the numbers stay as they are"
    elif found.unit != unit:
        why.append(
            f"column {look.name!r} goes from {unit} to {found.unit or 'a plain number'}: its header names {unit}"
        )

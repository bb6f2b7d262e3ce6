"""Units that a mapping leaves out: those of the header, as a guess takes them, and what is told of them."""

from sysid.base.errors import InputError
from sysid.channels.clock_units import digits_of_a_day, unit_of_clock
from sysid.channels.complaints import brief
from sysid.channels.contradictions import two_units, written_unit
from sysid.channels.looks import look_at
from sysid.channels.mapping import ROLES, Channel, ChannelMap, Clock
from sysid.channels.names import header, unit_text
from sysid.channels.units import COUNTS, convert, seconds
from sysid.channels.values import is_calibrated
from sysid.data.table import Table


def with_header_units(table: Table, mapping: ChannelMap) -> tuple[ChannelMap, tuple[str, ...]]:
    """The mapping with the units of the header where it leaves them out, and sentences on what the two say otherwise.

    Raises InputError for a unit that is left out where the header says two, or a clock that counts no unit.
    """
    clock, notes = _clock(table, mapping.clock)
    changed: dict[str, Clock | tuple[Channel, ...]] = {"clock": clock}
    for role in ROLES:
        read = [_channel(table, role, channel) for channel in getattr(mapping, role)]
        changed[role] = tuple(channel for channel, _ in read)
        notes += [note for _, note in read if note]
    return mapping.model_copy(update=changed), tuple(notes)


def _clock(table: Table, clock: Clock) -> tuple[Clock, list[str]]:
    if not clock.column:
        return clock, []
    typed = clock.column in table.dates or clock.column in table.undated or clock.column in table.timed
    if no_count := "" if typed else digits_of_a_day(clock.column):
        raise InputError(f"{table.path}: {no_count}")
    own = table.units.get(clock.column, "") or written_unit(clock.column)
    if "unit" in clock.model_fields_set:
        found = convert(own)
        if found.known and found.is_time and found.factor != seconds(clock.unit):
            named = f"the clock {clock.column!r} is read in {clock.unit}, as the mapping says; its header names {own}"
            return clock, [named]
        return clock, []
    look = look_at(table, clock.column)
    if not look.numeric or not look.step:
        return clock, []  # numbers that are refused by their row, or no clock
    said = unit_of_clock(look)
    if said.unit is None and said.stated:
        raise InputError(f"{table.path}: {said.why}")
    if not said.stated and said.unit != clock.unit:  # a step that is no usual one is the reason for many a mapping
        return clock, [
            f"the clock {clock.column!r} is read in s, steps of {look.step:.6g} s: neither the mapping nor the header "
            "names a unit; set unit of [clock] if it is another"
        ]
    if said.unit is None or seconds(said.unit) == seconds(clock.unit):
        return clock, []
    why = said.why.replace("its header says so", "as its header says").replace("its name says so", "as its name says")
    return (
        clock.model_copy(update={"unit": said.unit}),
        [f"the clock {clock.column!r} is read in {said.unit}, {why}; the mapping leaves its unit out"],
    )


def _channel(table: Table, role: str, channel: Channel) -> tuple[Channel, str]:
    of = header(channel.column, table.units.get(channel.column, ""))
    own, name, entry = unit_text(of), brief(channel.column), f"unit of [[{role}]] in the mapping"
    found = convert(own)
    if "unit" in channel.model_fields_set:
        given = convert(channel.unit)
        if is_calibrated(channel) or not (found.known and given.known and found.unit == given.unit != COUNTS):
            return channel, ""
        differs = abs(found.factor - given.factor) > 1e-9 * given.factor
        said = f"column {name!r} is read in {channel.unit}, as the mapping says; its header names {own}"
        return channel, said if differs else ""
    if is_calibrated(channel):
        return channel, f"column {name!r} is scaled by the mapping, and its values name no unit; set {entry}"
    if apart := two_units(look_at(table, channel.column)):
        raise InputError(f"{table.path}: {apart}; say which as {entry}")
    if own == "":
        return channel, f"column {name!r} names no unit: its numbers stay as they are; set {entry} if you know it"
    if not found.known or own == COUNTS:
        return channel, f"column {name!r} has the unit {own!r}: its numbers stay as they are"
    said = f"column {name!r} is read in {own}, as its header says: it becomes {found.unit or 'a plain number'}"
    return channel.model_copy(update={"unit": own}), said if found.unit != own else ""

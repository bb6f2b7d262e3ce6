"""A mapping bound to the columns of a table: what it names is there, what it leaves out is taken from the header.

Then the numbers of a column become the values of a channel in SI.
"""

from typing import Any

import numpy as np

from sysid.base.errors import InputError, printable
from sysid.channels.clock import digits_of_a_day, unit_of_clock
from sysid.channels.column import column_of, full_name, label, numbers, parse_header, unit_in_brackets
from sysid.channels.complaints import brief
from sysid.channels.conversion import COUNTS, Conversion, convert, is_time, seconds
from sysid.channels.mapping import ROLES, Channel, ChannelMap, Clock, Range
from sysid.data.hexadecimal import with_words
from sysid.data.table import Table
from sysid.data.words import with_sign

# Numbers that no channel has, and codes that an instrument writes for none.
HUGE = 1e16  # beside which a signal of usual size is rounded away when a mean is subtracted
OVERFLOW_CODES = (9.9e37, 9.91e37, 3.4028235e38)  # of SCPI, and of a float32 that is full
CODE_TOLERANCE = 1e-4  # of a code, which may be printed with few digits
USUAL_SIZE = 1e-9  # how small the others are beside what is no measurement
USUAL_SHARE = 0.1  # part of a column that has to be of usual size, so that the rest stands off


def check_mapping(table: Table, mapping: ChannelMap) -> None:
    """Raises InputError for columns that the table does not have, or that are given for two things."""
    for column, entry in mapping.columns().items():
        if column not in table.names:
            numbers(table, column, entry)  # which says what is like it
    channels = mapping.channels()
    if not channels:
        raise InputError(f"{table.path}: the mapping has no channel; add a table [[input]] and one [[output]]")
    for role, channel, _ in channels:
        if not channel.column:
            raise InputError(
                f"{table.path}: the mapping names no column of the {role}; set column of [[{role}]] to one of "
                f"{', '.join(table.names)}"
            )
    clock = mapping.clock
    uses: dict[str, str] = {clock.column: "as the clock"} if clock.column else {}
    for role, channel, _ in channels:
        if role == "other":
            continue
        use = f"as {role}"
        if channel.column in uses:
            first = uses[channel.column]
            conflict = f"twice {use}" if first == use else f"{first} and {use}"
            raise InputError(f"{table.path}: column {brief(channel.column)!r} is given {conflict}; name two columns")
        uses[channel.column] = use
    factors, directions = ([getattr(c, entry) for _, c, _ in channels] for entry in ("times", "direction"))
    for entry, columns in (
        ("times of the mapping", factors),
        ("direction of the mapping", directions),
        ("active of [range]", [mapping.range.active]),
    ):
        if clock.column and clock.column in columns:
            raise InputError(f"{table.path}: {entry} is the clock {brief(clock.column)!r}; name another column")
    dated = clock.column in table.dates or clock.column in table.timed
    if dated and (clock.period or seconds(clock.unit) != 1.0):
        raise InputError(
            f"{table.path}: column {brief(clock.column)!r} holds dates or times of day, which become seconds; leave "
            "unit and period of the clock out"
        )
    if not clock.column and clock.Ts is None and not any(channel.clock for channel in mapping.output):
        raise InputError(
            f"{table.path}: no sampling time is given; give it with --ts SECONDS or name a time column with --time "
            "(in a mapping: Ts or column of [clock])"
        )


def with_full_names(table: Table, mapping: ChannelMap) -> ChannelMap:
    """The mapping with the names of its columns in full, where it leaves their units out."""

    def full(part: Clock | Channel | Range, *entries: str) -> Any:
        names = {entry: getattr(part, entry) for entry in entries}
        changed = {entry: whole for entry, name in names.items() if name and (whole := full_name(table, name)) != name}
        return part.model_copy(update=changed) if changed else part

    changes: dict[str, Any] = {
        role: tuple(full(channel, "column") for channel in getattr(mapping, role)) for role in ROLES
    }
    changes = {role: channels for role, channels in changes.items() if channels != getattr(mapping, role)}
    clock = full(mapping.clock, "column")
    changes |= {} if clock is mapping.clock else {"clock": clock}
    part = full(mapping.range, "drive", "active", "experiment")
    changes |= {} if part is mapping.range else {"range": part}
    return mapping.model_copy(update=changes) if changes else mapping


def names_of(mapping: ChannelMap) -> tuple[dict[str, str], tuple[str, ...]]:
    """The name of each channel by its entry, and a note for each name that an input or output shares with another."""
    channels = mapping.channels()
    names = {entry: channel.name or label(channel.column, role) for role, channel, entry in channels}
    signal_names = [names[entry] for role, _, entry in channels if role != "other"]
    shared_names = [name for name in dict.fromkeys(signal_names) if signal_names.count(name) > 1]
    for role, channel, entry in channels:
        if role != "other" and names[entry] in shared_names:
            names[entry] = channel.column
    notes = tuple(
        f"{signal_names.count(name)} channels have the name {brief(name)!r}; they are told by column"
        for name in shared_names
    )
    return {entry: printable(name) for entry, name in names.items()}, notes


def with_header_units(table: Table, mapping: ChannelMap) -> tuple[ChannelMap, tuple[str, ...]]:
    """The mapping with the units of the header where it leaves them out, and sentences on what the two say otherwise.

    Raises InputError for a unit that is left out where the header says two, or a clock that counts no unit.
    """
    clock, notes = _clock_with_unit(table, mapping.clock)
    changes: dict[str, Clock | tuple[Channel, ...]] = {"clock": clock}
    for role in ROLES:
        pairs = [_channel_with_unit(table, role, channel) for channel in getattr(mapping, role)]
        changes[role] = tuple(channel for channel, _ in pairs)
        notes += [note for _, note in pairs if note]
    return mapping.model_copy(update=changes), tuple(notes)


def _clock_with_unit(table: Table, clock: Clock) -> tuple[Clock, list[str]]:
    """The clock with the unit of its header where the mapping names none, and notes on it."""
    name = clock.column
    if not name:
        return clock, []
    typed = name in table.dates or name in table.undated or name in table.timed
    if sentence := "" if typed else digits_of_a_day(name):
        raise InputError(f"{table.path}: {sentence}")
    if "unit" in clock.model_fields_set:
        unit = table.units.get(name, "") or unit_in_brackets(name)
        if is_time(unit) and seconds(unit) != seconds(clock.unit):
            return clock, [f"the clock {name!r} is read in {clock.unit}, as the mapping says; its header names {unit}"]
        return clock, []
    column = column_of(table, name)
    if not column.numeric or not column.step:
        return clock, []  # numbers that are refused by their row, or no clock
    reading = unit_of_clock(column)
    if reading.unit is None and reading.stated:
        raise InputError(f"{table.path}: {reading.why}")
    if not reading.stated and reading.unit != clock.unit:  # an unusual step is the reason for many a mapping
        return clock, [
            f"the clock {name!r} is read in s, steps of {column.step:.6g} s: neither the mapping nor the header "
            "names a unit; set unit of [clock] if it is another"
        ]
    if reading.unit is None or seconds(reading.unit) == seconds(clock.unit):
        return clock, []
    reason = reading.why.replace("its header says so", "as its header says")
    reason = reason.replace("its name says so", "as its name says")
    note = f"the clock {name!r} is read in {reading.unit}, {reason}; the mapping leaves its unit out"
    return clock.model_copy(update={"unit": reading.unit}), [note]


def _channel_with_unit(table: Table, role: str, channel: Channel) -> tuple[Channel, str]:
    """The channel with the unit of its header where the mapping names none, and a note or nothing."""
    unit = parse_header(channel.column, table.units.get(channel.column, "")).mapped_unit
    name, entry = brief(channel.column), f"unit of [[{role}]] in the mapping"
    conversion = convert(unit)
    if "unit" in channel.model_fields_set:
        target = convert(channel.unit)
        comparable = conversion.known and target.known and conversion.unit == target.unit != COUNTS
        if is_calibrated(channel) or not comparable:
            return channel, ""
        note = f"column {name!r} is read in {channel.unit}, as the mapping says; its header names {unit}"
        return channel, note if abs(conversion.factor - target.factor) > 1e-9 * target.factor else ""
    if is_calibrated(channel):
        return channel, f"column {name!r} is scaled by the mapping, and its values name no unit; set {entry}"
    if conflict := column_of(table, channel.column).unit_conflict:
        raise InputError(f"{table.path}: {conflict}; say which as {entry}")
    if unit == "":
        return channel, f"column {name!r} names no unit: its numbers stay as they are; set {entry} if you know it"
    if not conversion.known or unit == COUNTS:
        return channel, f"column {name!r} has the unit {unit!r}: its numbers stay as they are"
    note = f"column {name!r} is read in {unit}, as its header says: it becomes {conversion.unit or 'a plain number'}"
    return channel.model_copy(update={"unit": unit}), note if conversion.unit != unit else ""


def with_hexadecimal(table: Table, mapping: ChannelMap) -> tuple[Table, tuple[str, ...]]:
    """The table with numbers for the channels of `base` 16, and a note on channels whose words may be so too."""
    names = [channel.column for _, channel, _ in mapping.channels() if channel.base == 16]
    if not names or table.hexadecimal.issuperset(names):
        return table, ()
    others = {c.column: column_of(table, c.column) for _, c, _ in mapping.channels() if c.column not in names}
    doubtful = [brief(name) for name, c in others.items() if c.integer and float(c.finite.min()) >= 0]
    table = with_words(table, names)
    if not doubtful:
        return table, ()
    return table, (
        f"{', '.join(map(repr, doubtful))} stands beside hexadecimal words, but has digits alone and is read as a "
        "decimal number; set base = 16 there too if it is a hexadecimal word",
    )


def channel_values(table: Table, channel: Channel, entry: str, fill: bool) -> tuple[np.ndarray, Conversion]:
    """Values (n,) of the channel in SI, nan where its cells are empty, and the conversion of its unit.

    value = sign (scale x + offset); x is the number, as a signed word, through the adc's line, times another column.
    """
    x = numbers(table, channel.column, f"{entry}.column", fill)
    bad = overflow_mask(x)
    if bad.any():
        rest = f" (and {int(bad.sum()) - 1} more like it)" if bad.sum() > 1 else ""
        raise _error(
            table,
            channel,
            bad,
            f"found {x[np.argmax(bad)]:.6g}{rest}, far outside the others, as instruments write for an overflow or "
            "for no value; empty such cells, which are missing samples then, or remove the rows",
        )
    if channel.signed or channel.sign_bit:
        x = _add_sign(table, channel, x)
    unit = convert(channel.unit)
    if not is_calibrated(channel) and channel.sign * unit.factor == 1.0:
        return x, unit
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = _calibrate(table, channel, entry, x, fill) * (channel.sign * unit.factor)
    overflow = np.isinf(values) | (np.isnan(values) & np.isfinite(x))
    for factor in ("times", "direction") if overflow.any() else ():
        if column := getattr(channel, factor):
            overflow &= np.isfinite(numbers(table, column, f"{entry}.{factor}", fill))
    if overflow.any():
        k = int(np.argmax(overflow))
        remedy = f"of which adc, times, scale and offset of the mapping make {values[k]:g}; correct them"
        raise _error(table, channel, overflow, f"found {x[k]:g}, {remedy}")
    return values, unit


def is_calibrated(channel: Channel) -> bool:
    """Whether the mapping gives the channel's numbers another meaning than the file's."""
    return (
        channel.adc is not None
        or bool(channel.times or channel.direction)
        or (channel.scale, channel.offset) != (1.0, 0.0)
    )


def _calibrate(table: Table, channel: Channel, entry: str, x: np.ndarray, fill: bool) -> np.ndarray:
    """scale x + offset (n,), with x through the adc's line, times another column."""
    if channel.adc is not None:
        low, high, first, second = channel.adc.line()
        if channel.adc.bits is not None:
            bad = np.isfinite(x) & ((x < 0) | (x > high))
            if bad.any():
                remedy = f"where the adc of the mapping has 0 to {high:g} {COUNTS}; correct bits, or the row"
                raise _error(table, channel, bad, f"found {x[np.argmax(bad)]:g} {remedy}")
        x = first + (x - low) * ((second - first) / (high - low))
    if channel.times:
        x = x * numbers(table, channel.times, f"{entry}.times", fill)
    if channel.direction:
        way = numbers(table, channel.direction, f"{entry}.direction", fill)
        x = x * np.where(way > 0, 1.0, np.where(np.isnan(way), np.nan, -1.0))
    if channel.scale != 1.0:
        x = channel.scale * x
    return x + channel.offset if channel.offset else x


def _add_sign(table: Table, channel: Channel, x: np.ndarray) -> np.ndarray:
    """The words x (n,) with their sign."""
    values, bad = with_sign(x, channel.signed, channel.sign_bit)
    if bad.any():
        kind, entry = (f"a word of {channel.signed} bits", "signed")
        if channel.sign_bit:
            kind, entry = (f"a word whose sign is bit {channel.sign_bit}", "sign_bit")
        remedy = f"in {kind}; set {entry} of this channel in the mapping"
        raise _error(table, channel, bad, f"found {x[np.argmax(bad)]:g} {remedy}")
    return values


def _error(table: Table, channel: Channel, bad: np.ndarray, sentence: str) -> InputError:
    """The error for the first `bad` cell (n,) of a channel, with its row."""
    return table.error(channel.column, int(np.argmax(bad)), sentence)


def overflow_mask(values: np.ndarray) -> np.ndarray:
    """Which values (n,) are a code of an instrument, or lie so far outside all others as no measurement does."""
    if not len(values) or -HUGE < np.nanmin(values, initial=0.0) <= np.nanmax(values, initial=0.0) < HUGE:
        return np.zeros(len(values), dtype=bool)
    size = np.abs(values)
    huge = (size >= HUGE) & np.isfinite(size)
    usual_sizes = size[(size > 0) & (size < HUGE)]
    if len(usual_sizes) >= USUAL_SHARE * len(values) and usual_sizes.max() <= USUAL_SIZE * size[huge].min():
        return huge
    codes = np.any([np.abs(size - code) <= CODE_TOLERANCE * code for code in OVERFLOW_CODES], axis=0)
    return codes if (size < HUGE).any() and codes[huge].all() else np.zeros(len(values), dtype=bool)

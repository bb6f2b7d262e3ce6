"""What a mapping names: columns that exist, each for one thing, and names that tell the channels apart."""

from sysid.base.errors import InputError, printable
from sysid.channels.complaints import brief
from sysid.channels.mapping import ROLES, Channel, ChannelMap
from sysid.channels.names import label
from sysid.channels.units import seconds
from sysid.channels.values import numbers
from sysid.data.table import Table


def check_mapping(table: Table, mapping: ChannelMap) -> None:
    """Raises InputError for columns that the table does not have, or that are given for two things."""
    for column, entry in mapping.columns().items():
        if column not in table.names:
            numbers(table, column, entry)  # which says what is like it
    if not any(getattr(mapping, role) for role in ROLES):
        raise InputError(f"{table.path}: the mapping has no channel; add a table [[input]] and one [[output]]")
    for role in ROLES:
        for channel in getattr(mapping, role):
            if not channel.column:
                raise InputError(
                    f"{table.path}: the mapping names no column of the {role}; set column of [[{role}]] to one of "
                    f"{', '.join(table.names)}"
                )
    _check_columns(table, mapping)
    clock = mapping.clock
    dated = clock.column in table.dates or clock.column in table.timed
    if dated and (clock.wrap or seconds(clock.unit) != 1.0):
        raise InputError(
            f"{table.path}: column {brief(clock.column)!r} holds dates or times of day, which become seconds; leave "
            "unit and wrap of the clock out"
        )
    if not mapping.clock.column and mapping.clock.Ts is None:
        raise InputError(
            f"{table.path}: no sampling time is given; give it with --ts SECONDS or name a time column with --time "
            "(in a mapping: Ts or column of [clock])"
        )


def _check_columns(table: Table, mapping: ChannelMap) -> None:
    """Raises InputError for a column that is given for two things."""
    used: dict[str, str] = {mapping.clock.column: "as the clock"} if mapping.clock.column else {}
    for role in ("input", "output"):
        for channel in getattr(mapping, role):
            as_what = f"as {role}"
            if channel.column in used:
                before = used[channel.column]
                said = f"twice {as_what}" if before == as_what else f"{before} and {as_what}"
                raise InputError(f"{table.path}: column {brief(channel.column)!r} is given {said}; name two columns")
            used[channel.column] = as_what
    clock = mapping.clock.column
    times = [channel.times for role in ROLES for channel in getattr(mapping, role)]
    for entry, columns in (("times of the mapping", times), ("active of [range]", [mapping.range.active])):
        if clock and clock in columns:
            raise InputError(f"{table.path}: {entry} is the clock {brief(clock)!r}; name another column")


def names_of(channels: list[tuple[str, Channel, str]]) -> tuple[dict[str, str], tuple[str, ...]]:
    """The name of each channel by its entry, and a note for each name that an input or output shares with another."""
    names = {entry: label(channel, role) for role, channel, entry in channels}
    shown = [names[entry] for role, _, entry in channels if role != "other"]
    twice = [name for name in dict.fromkeys(shown) if shown.count(name) > 1]
    for role, channel, entry in channels:
        if role != "other" and names[entry] in twice:
            names[entry] = channel.column
    notes = tuple(
        f"{shown.count(name)} channels have the name {brief(name)!r}; they are told by column" for name in twice
    )
    return {entry: printable(name) for entry, name in names.items()}, notes

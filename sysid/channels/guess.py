"""A mapping from what a table shows, with the reason for each entry and what remains unclear."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.limits import SECONDS as LONGEST
from sysid.channels.clock import (
    contradiction_of_header,
    contradictions_of_comments,
    doubt_of_stated,
    is_named_clock,
    stated_sampling_time,
)
from sysid.channels.clock_choice import ClockChoice, choose_clock, clock_of_column, uneven_time
from sysid.channels.column import (
    Column,
    full_name,
    misspelt_number,
    numbers,
    numeric_columns,
    parse_header,
    soft_numbers,
    switch_words,
)
from sysid.channels.complaints import brief, list_names
from sysid.channels.conversion import is_time
from sysid.channels.experiments import starts_of_clock
from sysid.channels.guessed_channel import guess_channel
from sysid.channels.loops import note_on_controller, roles_in_loop
from sysid.channels.mapping import SHORTEST, Channel, ChannelMap, Clock, Range
from sysid.channels.order import oldest_first
from sysid.channels.own_clocks import with_own_clocks
from sysid.channels.roles import (
    DIRECTION,
    STRONG,
    Columns,
    Roles,
    choose_other,
    choose_signals,
    doubts_of_roles,
    is_counter,
    named_together,
    note_on_direction,
    note_on_left_out,
)
from sysid.channels.run_columns import column_of_experiments, in_blocks, labels, labels_of, note_on_stretches
from sysid.channels.switches import is_switch, switch_of
from sysid.channels.unused_clock import count_of_changes, notes_on_unused_clock, tell_order, tell_starts
from sysid.data.hexadecimal import columns_of_words
from sysid.data.table import Table
from sysid.formats import read_table

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

    `more` are the further columns of a role that has several; `drive` and `experiment` are those of [range], "" where
    there is none.
    """

    input: str | None = None
    output: str | None = None
    time: str | None = None
    time_unit: str | None = None
    Ts: float | None = None
    more: Mapping[str, tuple[str, ...]] | None = None
    drive: str | None = None
    experiment: str | None = None


@checked
@np.errstate(over="ignore")  # of numbers near the end of the range, which are refused where they are used
def guess(table: Table | str | os.PathLike[str], given: Given = Given()) -> Guess:
    """Clock, input and output of a table, or of the file at this path, by names, units and numbers, as far as they are
    not `given`.

    It never picks one of two readings that are equally plausible: it says what is unclear. Raises InputError for a
    table without columns of numbers, for a given column that it lacks, and for a file that cannot be read.
    """
    if not isinstance(table, Table):
        table = read_table(table)
    given = _with_full_names(table, given)
    named = (given.input, given.output, given.time, *chain.from_iterable((given.more or {}).values()))
    table, rigs, turns = in_blocks(table, used=named)
    table = oldest_first(table)
    columns = numeric_columns(table)
    if not columns:
        reason = misspelt_number(table, columns) or next(iter(table.undated.values()), "")
        message = f"no column holds numbers; found {list_names(table.names) or 'none'}"
        cell = next((brief(str(cells[0])) for cells in table.columns if len(cells)), "")
        form = f"such as {cell!r}; give one number a cell, parted by commas, semicolons, tabs or blanks"
        raise InputError(f"{table.path}: {message}{f': {reason}' if reason else f', {form}' if cell else ''}")
    further = given.more or {}
    for name in named:
        if name is not None and name not in columns:  # words of a switch, or a sentence on what it lacks
            columns[name] = Column(parse_header(name), numbers(table, name))
    for name in table.names:
        header = parse_header(name)
        if (is_switch(header) or header.has(DIRECTION)) and (switched := switch_words(table, name)) is not None:
            columns[name] = Column(header, switched)
    ruled, note = with_own_clocks(table)
    if note and given.time in (None, *ruled.clocks.values()):
        table = ruled
    timed, others = _columns_with_output(table, columns, given)
    if given.time in others and given.time in table.clocks.values():
        raise InputError(
            f"{table.path}: --time is {given.time!r}, which is not the clock of the output; name one of "
            f"{list_names([name for name in timed if is_named_clock(columns[name].header)])}"
        )
    if given.time is None and len({table.clocks[name] for name in timed if name in table.clocks}) > 1:
        choice = ClockChoice(Clock(Ts=given.Ts))  # which of them is open until the output is known
    else:
        choice = _guess_clock(table, columns if given.time is not None else timed, given)
    why, unclear, remarks = choice.why, choice.unclear, choice.remarks
    why += [turns] if turns else []
    if table is ruled and note:
        why.append(note)
        unclear += [f"{note.partition(';')[0]}; leave --ts out, which does not say when each was"] if given.Ts else []
    if choice.clock is not None and choice.clock.column in table.joined:
        why[:] = [f"columns {list_names(table.joined[choice.clock.column])} are one clock, in s"]
    clock = choice.clock or Clock()
    times = (clock.column, choice.unused, *choice.same, *others)
    signals = {name: column for name, column in columns.items() if name not in times and not column.dated}
    experiments = labels(table, rigs) or columns[rigs] if rigs else None
    experiments = experiments or column_of_experiments({**signals, **labels_of(table)})
    if experiments is not None and experiments.name not in (given.input, given.output):
        signals.pop(experiments.name, None)
    else:
        experiments = None
    roles = _guess_signals(table, columns, signals, given, why, unclear)
    if given.input is None and given.output is None:
        unclear += note_on_controller(roles, signals)
    channels: dict[str, list[Channel]] = {}
    inputs, output = named_together(unclear)
    if inputs and roles["input"] is None:
        roles = {"input": columns[inputs[0]], "output": columns[output]}
        further = {"input": tuple(inputs[1:])}
        remarks["input.column"] = "CHOOSE: an input, or delete this [[input]]"
    for role, first in roles.items():
        channels[role] = [] if first is not None else [Channel(column="")]
        if first is None:
            words = [f"{name} (base = 16)" for name in columns_of_words(table) if name not in columns]
            remarks[f"{role}.column"] = f"CHOOSE one of {', '.join([*signals, *words])}"
        for column in (first, *(columns[name] for name in further.get(role, ()))):
            if column is not None:
                channels[role].append(guess_channel(role, column, why, remarks))
                if column.unit_conflict:
                    unclear.append(f"{column.unit_conflict}; say which as unit of [[{role}]] in a mapping")
    why += note_on_direction(roles["input"], signals)
    why += note_on_left_out(roles, signals) if given.input is None else []
    switch, switch_note = (None, "") if given.drive is not None else switch_of(signals, table.names)
    if table is ruled and note:
        channels = {role: [_with_clock(table, clock, channel) for channel in channels[role]] for role in channels}
    mapping = ChannelMap(clock=clock, input=tuple(channels["input"]), output=tuple(channels["output"]))
    why += [switch_note] if switch_note else []
    counters = [] if clock.column else [choice.unused, *(c.name for c in columns.values() if is_counter(c))]
    starts = {name: found for name in counters if name and len(found := starts_of_clock(table, name))}
    if given.Ts is not None and not clock.column:
        tell_order(table, columns, [name for name in counters if name and name not in starts], signals, unclear, why)
    numbered, by_clock = experiments.name if experiments else "", next(iter(starts), "")
    if by_clock and not turns and len(starts[by_clock]) > count_of_changes(experiments):
        numbered, experiments = by_clock, None
        tell_starts(table, by_clock, starts[by_clock], given.Ts, unclear, why)
    part = Range(drive=switch.name if switch else "", experiment=numbered)
    mapping = mapping.model_copy(update={"range": part})
    why += [f"column {experiments.name!r} numbers experiments: its name says so"] if experiments and not rigs else []
    if not numbered and not given.experiment:
        used = {mapping.range.drive, *named, *(column.name for column in roles.values() if column is not None)}
        why += note_on_stretches(table, signals, used)
    return Guess(mapping, tuple(why), tuple(unclear), remarks)


def _with_full_names(table: Table, given: Given) -> Given:
    """What is given with the columns' names in full."""
    u, y, t = (name and full_name(table, name) for name in (given.input, given.output, given.time))
    more = {role: tuple(full_name(table, name) for name in names) for role, names in (given.more or {}).items()}
    return replace(given, input=u, output=y, time=t, more=more or None)


def _with_clock(table: Table, clock: Clock, channel: Channel) -> Channel:
    """The channel with the clock of its own, where it is another than that of the rows."""
    own = table.clocks.get(channel.column, "")
    return channel.model_copy(update={"clock": own}) if own != clock.column else channel


def _columns_with_output(table: Table, columns: Columns, given: Given) -> tuple[Columns, set[str]]:
    """The columns that have the output's clock, where columns have clocks of their own, and those that show a time
    otherwise; else all, and none. A clock that was made of two columns stands for these.
    """
    clocks = set(table.clocks.values())
    parts = {name for pair in table.joined.values() for name in pair}
    mine, others = {name: column for name, column in columns.items() if name not in parts}, parts
    if len(clocks) > 1:
        named = {name for name, column in mine.items() if is_named_clock(column.header)}
        stamps = {name for name in named if mine[name].rising or is_time(mine[name].header.unit)} | set(table.joined)
        signals = {name: column for name, column in mine.items() if name not in clocks | stamps}
        column = _guess_signals(table, mine, signals, given, [], [])["output"]
        if column is not None and column.name in table.clocks:
            clock = table.clocks[column.name]
            mine = {name: c for name, c in mine.items() if clock in (name, table.clocks.get(name))}
            others = parts | (clocks | stamps) - set(mine)
    joined = {name: column for name, column in mine.items() if name in table.joined}
    others |= set(table.joined) if joined else set()
    return joined or mine, others


def _guess_clock(table: Table, columns: Columns, given: Given) -> ClockChoice:
    """The clock as it is given, or as the columns and the header of the file show it."""
    if given.time is not None:
        try:
            choice = clock_of_column(columns[given.time], given.time_unit)
        except InputError as error:
            raise InputError(f"{table.path}: {error}") from None
        assert choice.clock is not None
        if contradiction := contradiction_of_header(table, choice.clock, columns[given.time].values):
            choice.why.append(f"{contradiction}: the column is used, as given")
        return choice
    signals = (given.input, given.output)  # no clock, whatever they look like
    choice = choose_clock({name: c for name, c in columns.items() if not c.dated and name not in signals})
    Ts = stated_sampling_time(table)
    if choice.clock is None and Ts is None:  # dates are often coarser than the samples
        choice = choose_clock({name: column for name, column in columns.items() if column.dated})
    own = [name for name in columns if name in table.clocks.values()]
    if choice.clock is None and len(own) == 1 < len(set(table.clocks.values())):  # x of x, y has no telling name
        choice = clock_of_column(columns[own[0]])
    if given.Ts is not None:
        notes = notes_on_unused_clock(table, choice.clock, columns, given.Ts) if not choice.unclear else []
        unused = choice.clock.column if choice.clock is not None else uneven_time(columns, signals)
        return ClockChoice(Clock(Ts=given.Ts), notes, unused=unused)
    if choice.clock is None and Ts is not None:
        doubt = doubt_of_stated(Ts, table, columns)
        clock = Clock(Ts=Ts) if SHORTEST <= Ts <= LONGEST else None  # no clock has it, which `doubt` says
        return ClockChoice(clock, [f"the sampling time is {Ts:g} s: the file says so"], [doubt] if doubt else [])
    if choice.clock is not None and not choice.unclear:
        name = choice.clock.column
        choice.why += contradictions_of_comments(table, choice.clock, columns[name].values)
        if contradiction := contradiction_of_header(table, choice.clock, columns[name].values):
            choice.unclear.append(f"{contradiction}; say which with --ts, or with --time {name!r}")
    if choice.clock is None:
        choice.unclear.append(next(iter(table.undated.values()), "") or misspelt_number(table, columns) or NO_CLOCK)
        choice.remarks["clock.Ts"] = "NEEDED"
    return choice


def _guess_signals(
    table: Table, columns: Columns, signals: Columns, given: Given, why: list[str], unclear: list[str]
) -> Roles:
    """The columns of input and output: those that are given, or by guess where none is."""
    if given.input is not None or given.output is not None:
        roles: Roles = {"input": columns.get(given.input or ""), "output": columns.get(given.output or "")}
        choose_other(roles, signals, why)
        unclear += doubts_of_roles(table, roles, columns, signals)
        return roles
    sure = not unclear
    roles = roles_in_loop(signals, why) or choose_signals(table, signals, why, unclear)
    if sure and not unclear:
        unclear += doubts_of_roles(table, roles, columns, signals)
    # A column called u or y that holds no numbers is not passed over for another one.
    for name, cells in zip(table.names, table.columns, strict=True):
        words = parse_header(name, table.units.get(name, "")).words
        for role, column in roles.items():
            strong = column is not None and column.header.words <= STRONG[role]
            if name not in columns and words and words <= STRONG[role] and not strong:
                places = np.flatnonzero(np.isnan(soft_numbers(table, name)))
                first = str(cells[int(places[0])]) if len(places) else ""
                reason = misspelt_number(table, columns, single=name) or f"the first is {first[:40]!r}; correct them"
                unclear.insert(
                    0,
                    f"column {name!r} is the {role} by its name, but most of its cells are no numbers: {reason}, or "
                    f"name another with --{role}",
                )
    return roles

"""From a file to a uniform record: cells become columns, columns channels, rows samples, one stage after the other.

The stages of `sample`: bind the mapping to the columns of the table; bring columns of several rates to the rows of the
output; keep the rows of its range; read the channels in
SI; drop rows without values at both ends; time the rows by stamps and a grid; place every channel on the grid; tell
what was corrected; change the sampling time. A table that holds several experiments is split before the range, which
counts in each.
"""

import os
from dataclasses import replace
from typing import Literal

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.channels.binding import (
    channel_values,
    check_mapping,
    names_of,
    with_full_names,
    with_header_units,
    with_hexadecimal,
)
from sysid.channels.column import numbers
from sysid.channels.conversion import unit_of_file
from sysid.channels.corrections import filling_of, interpolation_of, note_on_loose_stamps, sampling_of
from sysid.channels.experiments import alone, cut, join, note_on_falls, pieces_of
from sysid.channels.fresh import with_fresh_rows
from sysid.channels.grid import Grid, Timing, check_gaps, find_grid, place, value_of_each_stamp
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import ROLES, Channel, ChannelMap, Range, Repair
from sysid.channels.mapping_file import read_map
from sysid.channels.order import oldest_first
from sysid.channels.own_clocks import with_clocks
from sysid.channels.rates import at_output
from sysid.channels.repair import drop_empty_ends, keep_rows, total
from sysid.channels.restarts import SHORTEST
from sysid.channels.run_columns import in_blocks
from sysid.channels.signals import Signal, Signals, check_size, resample_signals
from sysid.channels.stamps import read_stamps, values_at
from sysid.data.missing import runs
from sysid.data.table import Table
from sysid.formats import read_table

Mapping = ChannelMap | str | os.PathLike[str]


@checked
def read_signals(path: str | os.PathLike[str], mapping: Mapping | None = None) -> Signals:
    """The record in the file at `path`: its channels in SI, by role, sampled uniformly.

    `mapping` is a ChannelMap or the path of its file; None guesses, and `notes` say what was guessed. Raises
    InputError that names file and place for what cannot be read, for what the mapping's repairs do not cover, and
    for a guess that is not sure.
    """
    table = read_table(path)
    return sample(table, read_map_of(mapping)) if mapping is not None else from_table(table)


def read_map_of(mapping: Mapping) -> ChannelMap:
    """The mapping, from its file if it is a path."""
    return mapping if isinstance(mapping, ChannelMap) else read_map(mapping)


def complete(table: Table, mapping: ChannelMap) -> tuple[ChannelMap, tuple[str, ...]]:
    """A mapping of rows alone, [range] and [repair], with guessed columns, and what was guessed; others as they are.

    `drive` = "" in its range says that no column is the drive's switch. Raises InputError for a guess that is not sure.
    """
    part = mapping.range
    if not mapping.model_fields_set or mapping.model_fields_set - {"range", "repair"}:
        return mapping, ()
    drive = part.drive if "drive" in part.model_fields_set else None
    result = guess(table, Given(drive=drive, experiment=part.experiment or None))
    columns = result.sure(table)
    own = columns.range
    part = part.model_copy(update={"drive": part.drive or own.drive, "experiment": part.experiment or own.experiment})
    return columns.model_copy(update={"range": part, "repair": mapping.repair}), result.why


def from_table(
    table: Table,
    given: Given = Given(),  # noqa: B008 - it is frozen
    range: Range = Range(),  # noqa: B008
    empty: Literal["refuse", "fill", "outputs"] = "refuse",
) -> Signals:
    """The record of a table by guess, as far as columns are not `given`; `empty` as in `Repair`.

    Of a clock that is given no sample may be lost: to fill some, say so in a mapping.
    """
    result = guess(table, given)
    repair = Repair(empty=empty) if given.time is None else Repair(longest_gap=0, empty=empty)
    mapping = result.sure(table)
    own = mapping.range
    range = range.model_copy(update={"drive": range.drive or own.drive, "experiment": own.experiment})
    mapping = mapping.model_copy(update={"range": range, "repair": repair})
    record = sample(table, mapping, result.why)
    if given.Ts is not None and given.time is not None and abs(given.Ts - record.Ts) > repair.jitter * record.Ts:
        raise InputError(
            f"{table.path}: --ts is {given.Ts:g} s but column {given.time!r} steps by {record.Ts:g} s; leave one "
            "of the two out"
        )
    return record


def parse_range(text: str) -> Range:
    """The range START:STOP [s] after the first stamp; either may be left out. Raises InputError for another text."""
    first, mark, last = text.partition(":")
    try:
        start, stop = (float(part) if part.strip() else None for part in (first, last))
    except ValueError:
        mark = ""
    if not mark:
        raise InputError(f"--range is {text!r}; give START:STOP in seconds after the first sample, such as 2.5:30")
    return Range(start=start, stop=stop)


@np.errstate(over="ignore")  # as in `guess`
def sample(table: Table, mapping: ChannelMap, notes: tuple[str, ...] = ()) -> Signals:
    """The record of `table` as `mapping` says; `notes` are put before the notes of the corrections.

    Raises InputError that names file, row and column for what the mapping's repairs do not cover.
    """
    mapping, guessed = complete(table, with_full_names(table, mapping))
    table, _, turns = in_blocks(table, mapping.range.experiment) if mapping.range.experiment else (table, "", "")
    table = oldest_first(table)
    notes, drive = (*notes, *guessed), mapping.range.drive
    notes = (*notes, turns) if turns and turns not in notes else notes
    if drive and drive not in (channel.column for channel in mapping.other):
        other = (*mapping.other, Channel(column=drive, unit="1", name=drive))
        mapping = mapping.model_copy(update={"other": other})
    check_mapping(table, mapping)
    table, words = with_hexadecimal(table, mapping)
    table, mapping, clock_notes = with_clocks(table, mapping)
    table, mapping, held = with_fresh_rows(table, mapping)
    table, rate_notes = at_output(table, mapping)
    mapping, unit_notes = with_header_units(table, mapping)
    dates = table.dates.get(mapping.clock.column)
    notes = (*notes, *words, *clock_notes, *held, *rate_notes, *unit_notes, *([dates] if dates else []))
    pieces = pieces_of(table, mapping)
    if len(pieces) > 1 or mapping.range.part is not None:
        notes = (*notes, *note_on_falls(table, mapping))
        return _sample_pieces(table, mapping, pieces, notes)
    return _sample_part(table, alone(mapping), notes)


def _sample_part(table: Table, mapping: ChannelMap, notes: tuple[str, ...]) -> Signals:
    """The record of one experiment; the table is in order, and the mapping has its units."""
    if mapping.range != Range(drive=mapping.range.drive):
        table, note = _keep_range(table, mapping)
        notes = (*notes, note)
    columns, units = _read_channels(table, mapping)
    table, columns, ends = drop_empty_ends(table, columns)
    timing = _time_rows(table, mapping, columns)
    values_and_marks, empty = _place_channels(table, mapping, timing, columns)
    names, name_notes = names_of(mapping)
    signals: dict[str, list[Signal]] = {role: [] for role in ROLES}
    for (role, channel, entry), unit, values in zip(mapping.channels(), units, values_and_marks, strict=True):
        signals[role].append(Signal(names[entry], channel.column, unit, *values))
    record = Signals(
        table.path,
        mapping,
        timing.grid.Ts,
        tuple(signals["input"]),
        tuple(signals["output"]),
        tuple(signals["other"]),
        sampling=sampling_of(timing),
    )
    share = float(record.missing.mean())
    if share > mapping.repair.most_lost:
        raise InputError(
            f"{table.path}: {share:.0%} of the samples are lost or empty, and at most "
            f"{mapping.repair.most_lost:.0%} are filled; set most_lost in [repair] of a mapping, or record again"
        )
    corrections = [
        *(timing.stamps.corrections if timing.stamps is not None else ()),
        ends,
        filling_of(timing, empty, int(record.missing.sum())),
        interpolation_of(timing),
    ]
    words = [correction.words for correction in corrections if correction.needed]
    notes = (*notes, *name_notes, *table.notes, *words)
    notes = (*notes, *note_on_loose_stamps(timing))
    record = resample_signals(replace(record, notes=notes, counts=total(corrections)), mapping.clock.Ts)
    return replace(record, notes=(*record.notes, *record.switch_notes(), *record.drive_notes()))


def _sample_pieces(table: Table, mapping: ChannelMap, pieces: list[tuple[int, int]], notes: tuple[str, ...]) -> Signals:
    """The record of the rows (start, stop) of each experiment, one by one; those of a few rows are left out."""
    column = next(iter(mapping.columns()))
    j = table.names.index(column)
    rows, n = table.rows[j], len(table.columns[j])
    kept = [(start, stop) for start, stop in pieces if stop - start >= SHORTEST] or pieces
    spans = [f"{table.places(2)} {rows[start]} to {rows[stop - 1]}" for start, stop in kept]
    parts = []
    for start, stop in kept:
        parts.append(_sample_part(cut(table, start, stop, n), alone(mapping), ()))
    left_out = sum(stop - start for start, stop in pieces) - sum(stop - start for start, stop in kept)
    if len(parts) == 1:
        others = f"; {left_out} row(s) in stretches shorter than {SHORTEST} are left out" if left_out else ""
        return replace(
            parts[0], notes=(*notes, f"used {spans[0]}, one experiment of the file{others}", *parts[0].notes)
        )
    record = join(parts, mapping, spans, left_out)
    return replace(record, notes=(*notes, *(note for note in record.notes if note not in notes)))


def _keep_range(table: Table, mapping: ChannelMap) -> tuple[Table, str]:
    """The table without the rows outside the mapping's range, and the note that says so."""
    part, clock, fill = mapping.range, mapping.clock, mapping.repair.empty == "fill"
    n = len(table.columns[table.names.index(next(iter(mapping.columns())))])
    keep = np.ones(n, dtype=bool)
    if part.start is not None or part.stop is not None:
        if clock.column:
            stamps = read_stamps(table, clock, mapping.repair, numbers(table, clock.column, "", fill))
            t = np.where(stamps.group >= 0, stamps.t[np.maximum(stamps.group, 0)], np.nan)
        else:
            t = np.arange(n) * (clock.Ts or 1.0)
        slack = 1e-6 * (float(np.nanmax(t)) or 1.0) + 1e-12
        low = -np.inf if part.start is None else part.start - slack
        high = np.inf if part.stop is None else part.stop + slack
        keep = (t >= low) & (t <= high)
        if keep.sum() < 2:
            span = ":".join("" if bound is None else f"{bound:g}" for bound in (part.start, part.stop))
            raise InputError(
                f"{table.path}: the range {span} s holds {int(keep.sum())} sample(s); the record goes from 0 to "
                f"{np.nanmax(t):.6g} s after its first stamp: give a range inside it"
            )
    if part.active:
        active = numbers(table, part.active, "range.active", fill)
        stretches = runs((active != 0) & keep)
        if not stretches:
            raise InputError(f"{table.path}: column {part.active!r} is 0 in all rows; leave active of [range] out")
        keep = np.zeros(n, dtype=bool)
        keep[slice(*stretches[0])] = True
    table = keep_rows(table, keep)
    return table, f"used rows {table.rows[0][0]} to {table.rows[0][-1]}, {int(keep.sum())} of {n}, as the range says"


def _read_channels(table: Table, mapping: ChannelMap) -> tuple[list[np.ndarray], list[str]]:
    """Values (n,) of every channel in SI, and its unit; raises InputError where they are too few or differ in n."""
    channels = mapping.channels()
    empty = mapping.repair.empty
    pairs = [
        channel_values(table, channel, entry, empty == "fill" or (empty == "outputs" and role == "output"))
        for role, channel, entry in channels
    ]
    columns = [values for values, _ in pairs]
    for (_, channel, _), values in zip(channels, columns, strict=True):
        if len(values) != len(columns[0]):
            raise InputError(
                f"{table.path}: column {channels[0][1].column!r} has {len(columns[0])} samples and "
                f"{channel.column!r} has {len(values)}; name two of one length, or the time stamps of each as "
                "clock of [[input]] and of [[output]] in a mapping"
            )
        if len(values) < 2:
            raise InputError(
                f"{table.path}: column {channel.column!r} has {len(values)} sample(s); at least 2 rows are needed"
            )
    return columns, [unit_of_file(channel.unit) for _, channel, _ in channels]


def _time_rows(table: Table, mapping: ChannelMap, columns: list[np.ndarray]) -> Timing:
    """The timing of the rows of the channels' `columns` (n,).

    Raises InputError for stamps that no grid fits, or with gaps that are not filled.
    """
    clock, repair, n = mapping.clock, mapping.repair, len(columns[0])
    if not clock.column:
        assert clock.Ts is not None
        index = np.arange(n)
        return Timing(None, Grid(clock.Ts, n, index, np.zeros((0, 2), dtype=int), clock.Ts, 0.0), index)
    raw = numbers(table, clock.column, "clock.column", repair.empty == "fill")
    if len(raw) != n:
        raise InputError(
            f"{table.path}: column {clock.column!r} has {len(raw)} samples and the signals have {n}; name another"
        )
    stamps = read_stamps(table, clock, repair, raw)
    roles = [role for role, _, _ in mapping.channels()]
    y = [values_at(x, stamps.rows) for role, x in zip(roles, columns, strict=True) if role == "output"]
    grid = find_grid(stamps.t, stamps.resolution, repair.jitter, clock.Ts, y)
    if grid is None:
        raise InputError(
            f"{table.path}: column {clock.column!r} has stamps of {stamps.resolution:g} s and steps of "
            f"{np.diff(stamps.t).min():g} to {np.diff(stamps.t).max():g} s, too coarse to tell a lost sample from "
            "rounding; give the sampling time with --ts if every row is there, or as Ts beside the column in [clock] "
            "of a mapping if some were lost"
        )
    check_gaps(table, mapping, stamps, grid)
    check_size(table.path, grid.N, n, grid.Ts)
    return Timing(stamps, grid, stamps.rows)


def _place_channels(
    table: Table, mapping: ChannelMap, timing: Timing, columns: list[np.ndarray]
) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Values and marks of filled samples (N,) of every channel, and the rows (m,) of empty cells."""
    repair, values_and_marks, empty = mapping.repair, [], []
    for (role, channel, _), values in zip(mapping.channels(), columns, strict=True):
        values = value_of_each_stamp(values, timing, repair.duplicates == "mean")
        empty.append(timing.rows[np.isnan(values)])
        longest = timing.grid.N if repair.empty == "outputs" and role == "output" else repair.longest_gap
        values_and_marks.append(place(table, timing, channel, values, role, longest))
    return values_and_marks, np.concatenate(empty)

"""From the columns of a table and a mapping to a uniform record, by stated rules that are counted."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import InputError, printable
from sysid.channels.cut import cut, kept
from sysid.channels.gaps import check_gaps
from sysid.channels.grid import LONG, Grid, find_grid
from sysid.channels.left_out import with_header_units
from sysid.channels.mapping import ROLES, Channel, ChannelMap, Range
from sysid.channels.named import check_mapping, names_of
from sysid.channels.rates import at, check_size
from sysid.channels.signals import Sampling, Signal, Signals
from sysid.channels.stamps import Stamps, read_stamps, taken
from sysid.channels.values import channel_values, numbers
from sysid.data.missing import fill as filled
from sysid.data.missing import runs
from sysid.data.table import Table


@dataclass(frozen=True)
class _Rows:
    """The rows that are used: their stamps, their grid, and how many rows there were."""

    stamps: Stamps | None
    grid: Grid
    rows: np.ndarray


def sample(table: Table, mapping: ChannelMap, notes: tuple[str, ...] = ()) -> Signals:
    """The record of `table` as `mapping` says; `notes` are put before the notes of the repairs.

    Raises InputError that names file, row and column for what the mapping's repairs do not cover.
    """
    check_mapping(table, mapping)
    mapping, said = with_header_units(table, mapping)
    read = table.dates.get(mapping.clock.column)
    notes = (*notes, *said, *([read] if read else []))
    if mapping.range != Range():
        table, note = cut(table, mapping)
        notes = (*notes, note)
    fill = mapping.repair.empty == "fill"
    channels = [
        (role, channel, _entry(mapping, role, k)) for role in ROLES for k, channel in enumerate(getattr(mapping, role))
    ]
    missing = mapping.repair.empty == "outputs"
    found = [
        channel_values(table, channel, entry, fill or (missing and role == "output"))
        for role, channel, entry in channels
    ]
    _check_lengths(table, [channel.column for _, channel, _ in channels], [values for values, _ in found])
    table, whole, ends = _without_empty_ends(table, [values for values, _ in found])
    found = [(x, unit) for x, (_, unit) in zip(whole, found, strict=True)]
    rows = _rows(table, mapping, len(whole[0]))
    counts = _counts(rows) | {"ends": ends}
    signals: dict[str, list[Signal]] = {role: [] for role in ROLES}
    names, said = names_of(channels)
    notes = (*notes, *said)
    for (role, channel, entry), (values, unit) in zip(channels, found, strict=True):
        held = channel.between == "held" or (channel.between == "" and role == "input")
        gathered = _gathered(values, rows, mapping)
        counts["empty cells"] += int(np.isnan(gathered).sum())
        longest = rows.grid.N if missing and role == "output" else mapping.repair.longest_gap
        placed, marks = _placed(table, rows, channel, gathered, held, longest)
        signals[role].append(Signal(names[entry], channel.column, printable(unit.unit), placed, marks))
    record = Signals(
        table.path,
        mapping,
        rows.grid.Ts,
        tuple(signals["input"]),
        tuple(signals["output"]),
        tuple(signals["other"]),
        notes=(*notes, *table.notes),
        counts=counts,
        sampling=_sampling(rows),
    )
    _check_lost(table, mapping, rows, record)
    counts["filled samples"] = int(record.missing.sum())
    record = replace(record, notes=(*record.notes, *_sentences(rows, counts, mapping)))
    record = replace(record, counts={name: n for name, n in counts.items() if n})
    return at(record, mapping.clock.Ts)


def _entry(mapping: ChannelMap, role: str, k: int) -> str:
    return f"{role} {k + 1}" if len(getattr(mapping, role)) > 1 else role


def _check_lengths(table: Table, names: list[str], columns: list[np.ndarray]) -> None:
    for name, values in zip(names, columns, strict=True):
        if len(values) != len(columns[0]):
            raise InputError(
                f"{table.path}: column {names[0]!r} has {len(columns[0])} samples and {name!r} has {len(values)}; "
                "name two of one length"
            )
        if len(values) < 2:
            raise InputError(f"{table.path}: column {name!r} has {len(values)} sample(s); at least 2 rows are needed")


def _without_empty_ends(table: Table, columns: list[np.ndarray]) -> tuple[Table, list[np.ndarray], int]:
    """Without the rows at both ends in which a channel has no value: there is nothing to fill them from."""
    known = np.flatnonzero(np.all([np.isfinite(values) for values in columns], axis=0))
    n = len(columns[0])
    if not len(known) or (known[0] == 0 and known[-1] == n - 1):
        return table, columns, 0
    inside = np.zeros(n, dtype=bool)
    inside[known[0] : known[-1] + 1] = True
    return kept(table, inside), [values[inside] for values in columns], int(n - inside.sum())


def _rows(table: Table, mapping: ChannelMap, n: int) -> _Rows:
    clock, repair = mapping.clock, mapping.repair
    if not clock.column:
        assert clock.Ts is not None
        index = np.arange(n)
        return _Rows(None, Grid(clock.Ts, n, index, np.zeros((0, 2), dtype=int), clock.Ts, 0.0), index)
    raw = numbers(table, clock.column, "clock.column", repair.empty == "fill")
    if len(raw) != n:
        raise InputError(
            f"{table.path}: column {clock.column!r} has {len(raw)} samples and the signals have {n}; name another"
        )
    stamps = read_stamps(table, clock, repair, raw)
    grid = find_grid(stamps.t, stamps.resolution, repair.jitter, clock.Ts)
    if grid is None:
        raise InputError(
            f"{table.path}: column {clock.column!r} has stamps of {stamps.resolution:g} s and steps of "
            f"{np.diff(stamps.t).min():g} to {np.diff(stamps.t).max():g} s, too coarse to tell a lost sample from "
            "rounding; give the sampling time with --ts instead, or in [clock] of a mapping without a column"
        )
    check_gaps(table, mapping, stamps, grid)
    check_size(table.path, grid.N, n, grid.Ts)
    return _Rows(stamps, grid, stamps.rows)


def _gathered(values: np.ndarray, rows: _Rows, mapping: ChannelMap) -> np.ndarray:
    """One value for each stamp: of the first of its rows, or their mean."""
    stamps = rows.stamps
    if stamps is None or mapping.repair.duplicates != "mean" or not stamps.duplicates:
        return taken(values, rows.rows)
    member = stamps.group >= 0
    group, kept = stamps.group[member], values[member]
    known = np.isfinite(kept)
    total = np.bincount(group[known], kept[known], len(stamps.t))
    count = np.bincount(group[known], minlength=len(stamps.t))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _placed(
    table: Table, rows: _Rows, channel: Channel, values: np.ndarray, held: bool, longest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Values (N,) on the grid and the marks (N,) of samples that were filled, at most `longest` in a row."""
    grid = rows.grid
    if grid.index is not None:
        if len(values) == grid.N and np.isfinite(values).all():
            return values, np.zeros(grid.N, dtype=bool)
        placed = np.full(grid.N, np.nan)
        placed[grid.index] = values
        bridged = filled(placed, longest, hold=held)
        _check_open(table, channel, rows, bridged.open, longest)
        return bridged.values, bridged.filled
    assert rows.stamps is not None
    known = np.isfinite(values)
    _check_open(table, channel, rows, ~known & _in_long_runs(~known, longest), longest)
    t, x = rows.stamps.t[known], values[known]
    at = np.arange(grid.N) * grid.Ts
    after = np.searchsorted(t, at * (1.0 + 1e-12) + 1e-9 * grid.Ts, side="right")
    before = np.maximum(after - 1, 0)
    placed = x[before] if held else np.interp(at, t, x)
    usual = _usual(rows)
    upcoming = np.append(t, np.inf)[after]
    far = at - t[before] > 0.5 * usual
    if not held:
        far &= upcoming - at > 0.5 * usual
    return placed, far & (after < len(t)) & (upcoming - t[before] > LONG * usual)


def _usual(rows: _Rows) -> float:
    assert rows.stamps is not None
    return max(float(np.percentile(np.diff(rows.stamps.t), 95)), rows.grid.Ts)


def _in_long_runs(mask: np.ndarray, longest: int) -> np.ndarray:
    found = np.zeros(len(mask), dtype=bool)
    for start, stop in runs(mask):
        found[start:stop] = stop - start > longest or start == 0 or stop == len(mask)
    return found


def _check_open(table: Table, channel: Channel, rows: _Rows, open_: np.ndarray, longest: int) -> None:
    if not open_.any():
        return
    start, stop = runs(open_)[0]
    index = rows.grid.index if rows.grid.index is not None and len(open_) == rows.grid.N else np.arange(len(open_))
    k = min(int(np.searchsorted(index, start)), len(rows.rows) - 1)
    raise table.error(
        table.names.index(channel.column),
        int(rows.rows[k]),
        f"found no value in {stop - start} samples in a row, where at most {longest} are filled, and none at an end; "
        "keep another part with --range, or set longest_gap in [repair] of a mapping",
    )


def _check_lost(table: Table, mapping: ChannelMap, rows: _Rows, record: Signals) -> None:
    share = float(record.missing.mean())
    if share > mapping.repair.most_lost:
        raise InputError(
            f"{table.path}: {share:.0%} of the samples are lost or empty, and at most "
            f"{mapping.repair.most_lost:.0%} are filled; set most_lost in [repair] of a mapping, or record again"
        )


def _counts(rows: _Rows) -> dict[str, int]:
    stamps = rows.stamps
    counts = {"wraps": 0, "duplicates": 0, "backward": 0, "stamps without a value": 0}
    if stamps is not None:
        counts = {
            "wraps": stamps.wraps,
            "duplicates": stamps.duplicates,
            "backward": stamps.backward,
            "stamps without a value": stamps.empty,
        }
    interpolated = rows.grid.N if rows.grid.index is None else 0
    return counts | {"lost": rows.grid.lost, "empty cells": 0, "interpolated": interpolated}


def _sampling(rows: _Rows) -> Sampling:
    if rows.stamps is None:
        return Sampling()
    grid = rows.grid
    return Sampling(np.diff(rows.stamps.t), grid.median, grid.off, rows.stamps.first, grid.index is None)


def _sentences(rows: _Rows, counts: dict[str, int], mapping: ChannelMap) -> list[str]:
    said = []
    if counts["wraps"]:
        said.append(f"the clock of {mapping.clock.wrap} bits started again {_times(counts['wraps'])}; undone")
    if counts["duplicates"]:
        how = "averaged" if mapping.repair.duplicates == "mean" else "left out"
        said.append(f"{counts['duplicates']} row(s) with the stamp of the row before {how}")
    if counts["backward"]:
        said.append(f"{counts['backward']} row(s) whose stamp runs back left out")
    if counts["stamps without a value"]:
        said.append(f"{counts['stamps without a value']} row(s) without a stamp left out")
    if counts["ends"]:
        said.append(f"{counts['ends']} row(s) without values at the ends left out")
    if counts["lost"] or counts["empty cells"]:
        said.append(
            f"{counts['lost']} lost sample(s) and {counts['empty cells']} empty cell(s) filled: inputs held, outputs "
            f"by a straight line and marked as missing ({counts['filled samples']} samples)"
        )
    if counts["interpolated"]:
        steps = np.diff(rows.stamps.t) if rows.stamps is not None else np.zeros(1)
        said.append(
            f"the stamps are not uniform (steps of {steps.min():.4g} to {steps.max():.4g} s): resampled every "
            f"{rows.grid.Ts:g} s, inputs held, outputs by straight lines"
        )
    return said


def _times(n: int) -> str:
    return "once" if n == 1 else f"{n} times"

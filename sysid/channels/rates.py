"""Several rates in one table: rows in which only some columns have a value, and columns with clocks of their own.

One rule: the rows are those of the output, an input is held, which is its last value at or before the output's stamp,
and nothing is interpolated but a second output, over no more than lost samples are filled. So no sample of the output
is lost, and none is made.
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.clock import unit_of_clock
from sysid.channels.column import column_of, numbers, soft_numbers
from sysid.channels.complaints import list_names
from sysid.channels.conversion import seconds
from sysid.channels.mapping import ChannelMap
from sysid.channels.repair import keep_rows
from sysid.channels.restarts import restarts
from sysid.data.missing import runs
from sysid.data.resampling import mean_of_held
from sysid.data.table import Table

# Limits chosen by hand; the logs of tests/contracts/test_rates.py hold them.
REPEATED = 0.05  # part of the values that equal the one before: what is written on change hardly has any
STRETCHES = 5  # without a value: fewer are samples that were lost
ALIKE = 0.9  # of the steps of a stream are within a tenth of the middle one
NEAR = 1.5  # steps of the output: a signal of longer ones that never repeats a value is written on change
JITTER = 0.01  # of a step of the output, by which the shift of an input may differ and still count as one
MARGIN = 1.5  # steps beyond those that are lost, by which stamps of a stream may be apart


@dataclass(frozen=True)
class Series:
    """The values (m,) of a column and their times t (m,) [s], which rise; `step` [s] is the middle one."""

    t: np.ndarray
    values: np.ndarray

    @property
    def step(self) -> float:
        """The middle step."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @property
    def repeats(self) -> bool:
        """Whether values are written again that did not change."""
        return len(self.t) > 1 and float(np.mean(np.diff(self.values) == 0)) > REPEATED

    def limit(self, own: "Series", longest: int) -> float:
        """How long [s] a value may be held: of a stream as long as lost samples are filled, else without end."""
        steps = np.diff(self.t)
        even = len(steps) > 0 and float(np.mean(np.abs(steps - self.step) <= 0.1 * self.step)) >= ALIKE
        is_stream = self.repeats or (even and self.step <= NEAR * own.step)
        return (longest + MARGIN) * max(self.step, own.step) if is_stream else np.inf


def at_output(table: Table, mapping: ChannelMap) -> tuple[Table, tuple[str, ...]]:
    """The table in the rows of its output, where columns have rates of their own, and notes; others as they are.

    Raises InputError for a cell that is no number, for an input that stops in between, and for outputs whose rates
    differ by more than is filled.
    """
    reference = _reference(table, mapping)
    names = _others(table, mapping, reference) if reference is not None else {}
    if reference is None or not any(_has_own_rate(table, name, reference) for name in (reference, *names)):
        return table, ()
    if not mapping.clock.column:
        raise InputError(
            f"{table.path}: columns {list_names([reference, *(n for n in names if names[n])])} have values "
            "in other rows or at other times, and a sampling time alone does not say when; leave --ts out where a "
            "column is the clock, name it with --time, or give a log in which every row has both"
        )
    filled = np.isfinite(soft_numbers(table, reference))
    clocks = _clocks(table, mapping, (reference, *names))
    times, reach = _times(table, mapping, clocks[reference], filled)
    own = _series(table, reference, times)
    _check_times(table, reference, clocks[reference], own)
    merged, sentences, longest = {}, [], mapping.repair.longest_gap
    for name, role in names.items():
        same = clocks[name] == clocks[reference]
        series = _series(table, name, times if same else _seconds(table, mapping, clocks[name]))
        if not same:
            _check_times(table, name, clocks[name], series)
        if role == "output":
            merged[name] = _line(table, series, own, longest, (name, reference))
            continue
        merged[name], how = _held(series, own, series.limit(own, longest), reach)
        sentences += [f"column {name!r}: {how}"] if role == "input" else []
    note = f"columns have rates of their own: the rows are the {len(own.t)} of {reference!r}, and inputs are held"
    table = _replaced(table, merged, filled, reference)
    keep = _between_values(merged, own, reach)
    outputs_may_lack = mapping.repair.empty == "outputs"
    streams = {n: x for n, x in merged.items() if not (outputs_may_lack and names[n] == "output")}
    _check_streams(table, mapping, streams, own, keep)
    if not keep.all():
        sentences.append(f"{int((~keep).sum())} row(s) at the ends, where another column has no value, are left out")
        table = keep_rows(table, keep)
    return table, (note, *sentences)


def _reference(table: Table, mapping: ChannelMap) -> str | None:
    """The output with the most values: its rows are the record's."""
    names = [channel.column for channel in mapping.output]
    counts = {name: int(np.isfinite(soft_numbers(table, name)).sum()) for name in names}
    return max(names, key=lambda name: counts[name]) if names and any(counts.values()) else None


def _others(table: Table, mapping: ChannelMap, reference: str) -> dict[str, str]:
    """The role of every other column that is read, where cells of it or of the output have no value, or which has
    another clock.
    """
    part, channels = mapping.range, mapping.channels()
    beside = (name for _, each, _ in channels for name in (each.times, each.direction))
    roles = dict.fromkeys((part.active, part.drive, part.experiment, *beside), "")
    roles |= {channel.column: role for role, channel, _ in reversed(channels)}
    n, own = table.length(reference), soft_numbers(table, reference)
    return {
        name: role
        for name, role in roles.items()
        if name not in ("", reference, mapping.clock.column)
        and (
            table.clocks.get(name) != table.clocks.get(reference)
            or (table.length(name) == n and not np.isfinite(soft_numbers(table, name) + own).all())
        )
    }


def _has_own_rate(table: Table, name: str, reference: str) -> bool:
    """Whether a column has values in some rows only: in others than the output, by its rate, or as it is written on
    change.
    """
    values = soft_numbers(table, name)
    filled = np.isfinite(values)
    places = np.flatnonzero(filled)
    if table.clocks.get(name) != table.clocks.get(reference):
        return True
    if len(places) < 2 or len(places) == len(values):
        return False
    if np.median(np.diff(places)) >= 2 or not (filled & np.isfinite(soft_numbers(table, reference))).any():
        return True
    sparse = 2 * len(places) <= len(values) and len(runs(~filled[places[0] : places[-1]])) >= STRETCHES
    return sparse and not Series(places.astype(float), values[places]).repeats


def _clocks(table: Table, mapping: ChannelMap, names: tuple[str, ...]) -> dict[str, str]:
    """The column of the time stamps of each column; those of columns with clocks of their own count from one origin.

    A stamp inside the messages of one topic is compared with the same stamp of another one, or not used for this.
    """
    column, reference = mapping.clock.column, table.clocks.get(names[0], "")
    own = {table.clocks.get(name, reference) for name in names}
    if len(own) < 2:
        return dict.fromkeys(names, column)
    if column == reference:
        return {name: table.clocks.get(name, reference) for name in names}
    prefix = reference.rpartition(".")[0]
    stamps = {clock: clock.rpartition(".")[0] + column.removeprefix(prefix) for clock in own}
    use_stamps = column.startswith(prefix) and all(stamp in table.names for stamp in stamps.values())
    clocks = {name: table.clocks.get(name, reference) for name in names}
    return {name: stamps[clock] if use_stamps else clock for name, clock in clocks.items()}


def _times(table: Table, mapping: ChannelMap, clock: str, filled: np.ndarray) -> tuple[np.ndarray, float]:
    """Times (n,) [s] of the rows of the output, and how long [s] an experiment is at most; the numbers of the rows
    where no clock says them.

    Experiments behind each other are taken far apart, so that none takes a value of another one. A clock that starts
    again for another signal alone, written below the output, is one experiment.
    """
    n = len(filled)
    if not clock or mapping.clock.period or table.length(clock) != n:
        return np.arange(n, dtype=float), np.inf
    t = _seconds(table, mapping, clock)
    part = np.zeros(n, dtype=int)
    part[restarts(t, table)] = 1
    part = np.cumsum(part)
    span = float(np.nanmax(t) - np.nanmin(t))
    return (t + part * (2.0 * span + 1.0), span) if np.ptp(part[filled]) else (t, np.inf)


def _seconds(table: Table, mapping: ChannelMap, clock: str) -> np.ndarray:
    """The stamps (n,) [s] of a clock: in the unit of the mapping, or in that of the file where it is another one."""
    unit = mapping.clock.unit
    if clock != mapping.clock.column:
        unit = table.units.get(clock, "") or unit_of_clock(column_of(table, clock)).unit or unit
    return soft_numbers(table, clock) * seconds(unit)


def _series(table: Table, name: str, t: np.ndarray) -> Series:
    """The values of a column in the order of their times t (n,); raises InputError for a cell that is no number."""
    values = numbers(table, name, fill=True)
    mask = np.isfinite(values) & np.isfinite(t)
    order = np.argsort(t[mask], kind="stable")
    return Series(t[mask][order], values[mask][order])


def _check_times(table: Table, name: str, clock: str, series: Series) -> None:
    """Raises InputError for a value of a column that has no time, at the cell of its clock."""
    filled = np.isfinite(soft_numbers(table, name))
    if len(series.t) < int(filled.sum()):
        numbers(keep_rows(table, filled), clock)


def _held(series: Series, own: Series, limit: float, reach: float) -> tuple[np.ndarray, str]:
    """The last value at or before each time of `own`, held for at most `reach` [s], else nan; and how it was taken.

    A stream, which has a `limit` [s], is held over gaps up to it: at an end it is known for one of its steps.
    A series that changes now here and now there within the steps of `own` is held in between and becomes the mean of
    each step: a single instant would not tell what drove the plant.
    """
    near = own.t + JITTER * own.step  # stamps that are equal but for their last digits are one instant
    last = np.searchsorted(series.t, near, side="right") - 1
    source = np.maximum(last, 0)
    age = own.t - series.t[source]
    gap = np.append(series.t, np.inf)[last + 1] - series.t[source]
    known = np.where(gap <= limit, reach, min((1.0 + JITTER) * series.step, reach) if np.isfinite(limit) else reach)
    values = np.where((last >= 0) & (age <= known), series.values[source], np.nan)
    changes = series.t[np.flatnonzero(np.diff(series.values, prepend=np.nan) != 0)]
    following = np.searchsorted(near, changes)
    inside = (following > 0) & (following < len(own.t))
    shift = own.t[following[inside]] - changes[inside]
    if not len(shift):
        return values, f"{len(series.t)} value(s)"
    if np.ptp(shift) > JITTER * own.step:
        end = np.minimum(np.append(own.t[1:], np.inf), own.t + own.step)
        mean = mean_of_held(series.t, series.values, own.t, end)
        text = f"{len(series.t)} values, which change anywhere between the output's: held, then the mean of each step"
        return np.where(np.isfinite(values), mean, np.nan), text
    delay = float(np.median(shift))
    if delay <= JITTER * own.step:
        return values, f"{len(series.t)} values, at stamps of the output's"
    return values, (
        f"{len(series.t)} values, each {delay * 1e3:.4g} ms before one of the output's; this shift stays: the answer "
        "to a step begins within it, which nk = 0 and one more coefficient nb hold"
    )


def _between_values(merged: dict[str, np.ndarray], own: Series, reach: float) -> np.ndarray:
    """The rows (n,) of each experiment but those at its ends in which a column has no value."""
    known = np.all([np.ones(len(own.t)), *map(np.isfinite, merged.values())], axis=0)
    keep = np.zeros(len(own.t), dtype=bool)
    for rows in np.split(np.arange(len(own.t)), np.flatnonzero(np.diff(own.t) > reach) + 1):
        ends = rows[known[rows]]
        keep[slice(ends[0], ends[-1] + 1) if len(ends) else slice(rows[0], rows[-1] + 1)] = True
    return keep


def _line(table: Table, series: Series, own: Series, longest: int, names: tuple[str, str]) -> np.ndarray:
    """A second output at the times of the first, by straight lines; nan where more samples are lost than are filled."""
    limit = (longest + MARGIN) * own.step
    if series.step > limit:
        raise InputError(
            f"{table.path}: column {names[0]!r} has a value every {series.step:.4g} s and {names[1]!r} every "
            f"{own.step:.4g} s, and at most {longest} samples of an output in a row are filled; take one output at a "
            "time, or set longest_gap in [repair] of a mapping"
        )
    right = np.clip(np.searchsorted(series.t, own.t), 1, len(series.t) - 1)
    inside = (own.t >= series.t[0]) & (own.t <= series.t[-1]) & (series.t[right] - series.t[right - 1] <= limit)
    return np.where(inside, np.interp(own.t, series.t, series.values), np.nan)


def _check_streams(
    table: Table, mapping: ChannelMap, merged: dict[str, np.ndarray], own: Series, keep: np.ndarray
) -> None:
    """Raises InputError with the first row within the range in which a held column has no value any more."""
    part, t = mapping.range, own.t - own.t[0]
    low, high = (bound if bound is not None else end for bound, end in ((part.start, -np.inf), (part.stop, np.inf)))
    for name, values in merged.items():
        for start, stop in runs(np.isnan(values) & keep & (t >= low) & (t <= high)):
            before = f"{part.start or 0:g}:{t[max(start - 1, 0)]:.10g}"
            after = f"{t[min(stop, len(t) - 1)]:.10g}:{min(high, t[-1]):.10g}"
            raise table.error(
                name,
                start,
                f"found no value for {t[stop - 1] - t[start] + own.step:.4g} s, though the column has one more often; "
                f"at most {mapping.repair.longest_gap} in a row are filled: keep one piece with --range {before} or "
                f"{after}, or set longest_gap in [repair] of a mapping",
            )


def _replaced(table: Table, merged: dict[str, np.ndarray], filled: np.ndarray, reference: str) -> Table:
    """The table in the `filled` rows of the reference, with the merged columns in place of their own."""
    j = table.names.index(reference)
    blank = np.zeros(len(filled))
    columns = tuple(blank if n in merged else cells for n, cells in zip(table.names, table.columns, strict=True))
    rows = tuple(table.rows[j] if n in merged else each for n, each in zip(table.names, table.rows, strict=True))
    table = keep_rows(replace(table, columns=columns, rows=rows, clocks={}), filled)
    columns = tuple(merged.get(name, cells) for name, cells in zip(table.names, table.columns, strict=True))
    return replace(table, columns=columns)

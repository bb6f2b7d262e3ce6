"""Several experiments in one table: a clock that starts again, and a column that numbers them.

Rows of two experiments never meet in one record: the table is split before its stamps become a grid.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sysid.base.errors import InputError
from sysid.base.rates import same_rate
from sysid.channels.column import column_of, numbers, soft_numbers
from sysid.channels.complaints import brief
from sysid.channels.mapping import ChannelMap, Range
from sysid.channels.repair import keep_rows
from sysid.channels.restarts import SHORTEST, pauses, restarts, usual_step
from sysid.channels.run_columns import labels
from sysid.channels.signals import Signals
from sysid.channels.stamps import is_hour
from sysid.data.table import Table

# Limits chosen by hand; the logs of tests/corpus and of tests/contracts/test_experiments.py hold them.
PERIODS = (60.0, 1e3, 3600.0, 6e4, 86400.0, 1e6, 1e9, *(2.0**k for k in range(8, 33)))  # of counters that wrap
SHOWN = 6  # restarts in a sentence


def may_be_counter(stamps: np.ndarray, starts: np.ndarray) -> float:
    """The period of a counter that would start again as the stamps (n,) do, with its usual step; 0: none."""
    shown = stamps[np.isfinite(stamps)]
    step = usual_step(shown)
    tops = stamps[starts - 1] + step - stamps[starts]
    periods = [p for p in PERIODS if len(tops) and np.all(np.abs(tops - p) <= 0.01 * step)]
    periods = [p for p in periods if np.ptp(shown) < p]  # a counter shows no more
    return periods[0] if periods else 0.0


def pieces_of(table: Table, mapping: ChannelMap) -> list[tuple[int, int]]:
    """Rows (start, stop) of each experiment; one piece of a table that is one.

    Raises InputError where the clock may be a counter that wraps, and for a `part` that there is not.
    """
    clock, part = mapping.clock, mapping.range
    n = len(table.columns[table.names.index(next(iter(mapping.columns())))])
    starts: set[int] = set()
    if part.experiment:
        starts |= set(_starts_of(table, part.experiment, mapping.repair.longest_gap).tolist())
    if clock.column and not clock.period:
        found = starts_of_clock(table, clock.column, mapping.repair.longest_gap)
        if len(found) and not part.experiment and (doubt := doubt_of_starts(table, clock.column, found)):
            raise table.error(clock.column, int(found[0]), doubt)
        starts |= set(found.tolist())
    ends = sorted({0, n} | starts)
    pieces = list(pairwise(ends))
    if part.part is None:
        return pieces
    if not 1 <= part.part <= len(pieces):
        raise InputError(
            f"{table.path}: part of [range] is {part.part}, and the file holds {len(pieces)} experiment(s); give 1 to "
            f"{len(pieces)}, or leave it out"
        )
    return pieces[part.part - 1 : part.part]


def _starts_of(table: Table, column: str, longest: int) -> np.ndarray:
    """Places (m,) at which experiments start by a column that numbers or names them, or a clock, which rises in most
    rows: there also behind each pause of more than `longest` samples.
    """
    if (named := labels(table, column)) is not None:
        return np.flatnonzero(np.diff(named.values)) + 1
    steps = np.diff(column_of(table, column).finite)
    if len(steps) and np.median(steps) > 0:
        return starts_of_clock(table, column, longest, every=True)
    return np.flatnonzero(np.diff(numbers(table, column, "range.experiment"))) + 1


def starts_of_clock(table: Table, column: str, longest: int = 0, every: bool = False) -> np.ndarray:
    """Places (m,) at which the clock of a column starts again, or goes on behind a pause as `pauses` has it; an hour
    less or more at a change of clocks is no start, if not asked for as a pause.
    """
    stamps = soft_numbers(table, column)
    starts = np.union1d(restarts(stamps, table), pauses(stamps, longest, every))
    if not len(starts) or column not in table.local:
        return starts
    usual = usual_step(stamps[np.isfinite(stamps)])
    steps = stamps[starts] - stamps[starts - 1]
    return starts[(every & (steps > 0)) | ~is_hour(steps - usual, usual)]


def note_on_falls(table: Table, mapping: ChannelMap) -> list[str]:
    """What is said of a clock that falls back by less than it has gone: another experiment, or a clock set right."""
    column = mapping.clock.column or mapping.range.experiment
    if (
        not column
        or mapping.range.experiment not in ("", column)
        or mapping.clock.period
        or labels(table, column) is not None
        or not column_of(table, column).rising
    ):
        return []
    stamps = soft_numbers(table, column)
    back = [k for k in restarts(stamps, table).tolist() if stamps[0] < stamps[k] < stamps[k - 1]]
    if not back:
        return []
    return [
        f"column {column!r} falls back at {rows_text(table, column, back)}, into times that were there before: taken "
        "for experiments; for one record whose clock was set back, give Ts of [clock] in a mapping, without column "
        "and without experiment of [range]"
    ]


def doubt_of_starts(table: Table, column: str, starts: np.ndarray, Ts: float | None = None) -> str:
    """The sentence on a clock whose starts (m,) may be wraps of a counter; nothing where they cannot.

    Beside a sampling time Ts that is given the counter may count samples: then its period says nothing of seconds.
    """
    period = may_be_counter(soft_numbers(table, column), starts)
    if not period:
        return ""
    dated = column in table.dates or column in table.timed
    way = f"period = {period:.10g}" if Ts is None else f'column = "" and Ts = {Ts:.10g}'
    counter = "" if dated else f"{way} under [clock] for a counter, or "
    return (
        f"the clock starts again at {rows_text(table, column, starts.tolist())}, each time after {period:.10g}: a "
        f"counter that wraps, or another experiment; in a mapping, set {counter}experiment = "
        f'"{brief(column)}" under [range] for experiments'
    )


def rows_text(table: Table, column: str, places: Sequence[int]) -> str:
    """The rows of the file at these places."""
    rows = table.rows[table.names.index(column)]
    more = f" and {len(places) - SHOWN} more" if len(places) > SHOWN else ""
    shown = ", ".join(str(rows[k]) for k in places[:SHOWN])
    return f"{table.places(len(places))} {shown}{more}"


def cut(table: Table, start: int, stop: int, n: int) -> Table:
    """The rows of one experiment of a table of n."""
    keep = np.zeros(n, dtype=bool)
    keep[start:stop] = True
    return keep_rows(table, keep)


def alone(mapping: ChannelMap) -> ChannelMap:
    """The mapping of one experiment that is cut out already."""
    changes = {"experiment": "", "part": None}
    return mapping.model_copy(update={"range": Range(**{**mapping.range.model_dump(), **changes})})


def join(parts: Sequence[Signals], mapping: ChannelMap, spans: Sequence[str], left_out: int) -> Signals:
    """One record of the experiments `parts`, of which `spans` names the rows; raises InputError for other rates."""
    first = parts[0]
    for part, span in zip(parts, spans, strict=True):
        if not same_rate(part.Ts, first.Ts):
            raise InputError(
                f"{first.path}: the experiment in {spans[0]} is sampled every {first.Ts:g} s and that in {span} every "
                f"{part.Ts:g} s; keep one with part of [range] in a mapping, or set Ts of [clock]"
            )
    roles = {
        role: tuple(
            replace(
                signal,
                values=np.concatenate([getattr(part, role)[k].values for part in parts]),
                missing=np.concatenate([getattr(part, role)[k].missing for part in parts]),
            )
            for k, signal in enumerate(getattr(first, role))
        )
        for role in ("input", "output", "other")
    }
    counts: dict[str, int] = {}
    for part in parts:
        counts = {kind: counts.get(kind, 0) + part.counts.get(kind, 0) for kind in (*counts, *part.counts)}
    clock = first.sampling
    if len(clock.steps):
        steps = np.concatenate([part.sampling.steps for part in parts])
        clock = replace(clock, steps=steps, off=max(part.sampling.off for part in parts))
    sizes = ", ".join(f"{span} ({part.N} samples)" for part, span in list(zip(parts, spans, strict=True))[:SHOWN])
    more = f" and {len(parts) - SHOWN} more" if len(parts) > SHOWN else ""
    notes = [
        f"the file holds {len(parts)} experiments, each with its own initial state: {sizes}{more}; part = 1 under "
        "[range] of a mapping keeps the first alone"
    ]
    notes += [f"{left_out} row(s) between them, in stretches shorter than {SHORTEST}, are left out"] if left_out else []
    notes += [note for note in first.notes if all(note in part.notes for part in parts)]
    for part, span in zip(parts, spans, strict=True):
        notes += [f"{span}: {note}" for note in part.notes if note not in notes]
    return replace(
        first,
        mapping=mapping,
        input=roles["input"],
        output=roles["output"],
        other=roles["other"],
        notes=tuple(notes),
        counts=counts,
        sampling=clock,
        lengths=tuple(part.N for part in parts),
    )

"""Gaps between time stamps that are longer than the mapping allows, told with the pieces between them."""

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.grid import LONG, Grid
from sysid.channels.local_time import change_of_clocks
from sysid.channels.mapping import ChannelMap
from sysid.channels.stamps import Stamps
from sysid.data.table import Table

MOST_PIECES = 4  # that a message lists


def check_gaps(table: Table, mapping: ChannelMap, stamps: Stamps, grid: Grid) -> None:
    """Raises InputError with the row of the first gap that is not filled, and with what to do."""
    repair, gaps = mapping.repair, grid.gaps
    worst = int(gaps[:, 1].max()) if len(gaps) else 0
    if worst > repair.longest_gap:
        first = int(np.argmax(gaps[:, 1] > repair.longest_gap))
        raise _gap_error(table, mapping, stamps, grid, first, f"at most {repair.longest_gap} in a row are filled")
    if grid.lost > repair.most_lost * grid.N:
        first = int(np.argmax(gaps[:, 1]))
        part = f"{grid.lost} of {grid.N} samples are lost, and at most {repair.most_lost:.0%} are filled"
        raise _gap_error(table, mapping, stamps, grid, first, part)


def _gap_error(table: Table, mapping: ChannelMap, stamps: Stamps, grid: Grid, gap: int, said: str) -> InputError:
    k, repair = int(grid.gaps[gap, 0]), mapping.repair
    step = stamps.t[k + 1] - stamps.t[k]
    asked = mapping.clock.Ts
    if asked is not None and asked < grid.median / LONG:
        least = grid.median / (repair.longest_gap + 1)
        return InputError(
            f"{table.path}: Ts of [clock] is {asked:g} s and most steps of column {mapping.clock.column!r} are "
            f"{grid.median:.4g} s, and {said}; give Ts of at least {least:.4g} s, or leave it out"
        )
    tolerance = f" (within {mapping.repair.jitter:.0%})" if grid.index is not None else ""
    return table.error(
        table.names.index(mapping.clock.column),
        int(stamps.rows[k + 1]),
        f"found a step of {step:.4g} s where most are {grid.median:.4g} s{tolerance}"
        f"{change_of_clocks(table, mapping.clock, step, grid.median)}; {said}: "
        f"{_pieces(mapping, stamps, grid)}, or set longest_gap and most_lost in [repair] of a mapping",
    )


def _pieces(mapping: ChannelMap, stamps: Stamps, grid: Grid) -> str:
    """The pieces between long gaps, as times to give."""
    limit = min(mapping.repair.longest_gap, int(grid.gaps[:, 1].max()) - 1)
    cuts = grid.gaps[grid.gaps[:, 1] > limit, 0]
    starts, stops = np.concatenate([[0], cuts + 1]), np.concatenate([cuts, [len(stamps.t) - 1]])
    long = np.argsort(stops - starts)[::-1][:MOST_PIECES]
    texts = [f"{stamps.t[starts[k]]:.6g}:{stamps.t[stops[k]]:.6g}" for k in sorted(long) if stops[k] > starts[k]]
    return f"cut it and keep one piece with --range {' or '.join(texts)}"

"""The rows of a table that its mapping's range keeps."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.mapping import ChannelMap
from sysid.channels.stamps import read_stamps
from sysid.channels.values import numbers
from sysid.data.missing import runs
from sysid.data.table import Table, Texts


def cut(table: Table, mapping: ChannelMap) -> tuple[Table, str]:
    """The table without the rows outside the mapping's range."""
    part, clock, repair = mapping.range, mapping.clock, mapping.repair
    n = len(table.columns[table.names.index(next(iter(mapping.columns())))])
    keep = np.ones(n, dtype=bool)
    if part.start is not None or part.stop is not None:
        if clock.column:
            stamps = read_stamps(table, clock, repair, numbers(table, clock.column, "", repair.empty == "fill"))
            t = np.where(stamps.group >= 0, stamps.t[np.maximum(stamps.group, 0)], np.nan)
        else:
            t = np.arange(n) * (clock.Ts or 1.0)
        slack = 1e-6 * (float(np.nanmax(t)) or 1.0) + 1e-12
        low = -np.inf if part.start is None else part.start - slack
        high = np.inf if part.stop is None else part.stop + slack
        keep = (t >= low) & (t <= high)
        if keep.sum() < 2:
            raise InputError(
                f"{table.path}: the range {_span(part.start, part.stop)} s holds {int(keep.sum())} sample(s); the "
                f"record goes from 0 to {np.nanmax(t):.6g} s after its first stamp: give a range inside it"
            )
    if part.active:
        active = numbers(table, part.active, "range.active", repair.empty == "fill")
        stretches = runs((active != 0) & keep)
        if not stretches:
            raise InputError(f"{table.path}: column {part.active!r} is 0 in all rows; leave active of [range] out")
        keep = np.zeros(n, dtype=bool)
        keep[slice(*stretches[0])] = True
    fresh = kept(table, keep)
    return fresh, f"used rows {fresh.rows[0][0]} to {fresh.rows[0][-1]}, {int(keep.sum())} of {n}, as the range says"


def kept(table: Table, keep: np.ndarray) -> Table:
    """The table with the marked rows (n,) alone; columns of another length are left out."""
    chosen = np.flatnonzero(keep)
    whole = [j for j, cells in enumerate(table.columns) if len(cells) == len(keep)]
    columns = tuple(_picked(table.columns[j], chosen) for j in whole)
    same = {id(table.rows[j]): table.rows[j] for j in whole}  # most files have one for all columns
    taken = {key: np.asarray(each)[chosen] for key, each in same.items()}
    rows: tuple[Any, ...] = tuple(taken[id(table.rows[j])] for j in whole)
    return replace(table, names=tuple(table.names[j] for j in whole), columns=columns, rows=rows)


def _picked(cells: Sequence[str] | np.ndarray, chosen: np.ndarray) -> Sequence[str] | np.ndarray:
    if isinstance(cells, Texts):
        return cells.taken(chosen)
    return cells[chosen] if isinstance(cells, np.ndarray) else [cells[k] for k in chosen.tolist()]


def _span(start: float | None, stop: float | None) -> str:
    return f"{'' if start is None else f'{start:g}'}:{'' if stop is None else f'{stop:g}'}"

"""A repair of a record: what was found, in which rows, what was done about it, and in which words it is told."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sysid.data.table import Table, Texts

KINDS = (
    "wraps",
    "duplicates",
    "backward",
    "stamps without a value",
    "lost",
    "empty cells",
    "interpolated",
    "ends",
    "filled samples",
)


@dataclass(frozen=True)
class Correction:
    """One thing that was put right: how often each of `KINDS` was met, and the sentence about it.

    `rows` are the positions in the table of the rows that it concerns, none where it concerns all.
    """

    counts: Mapping[str, int]
    words: str
    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    @property
    def needed(self) -> bool:
        """Whether there was anything to put right."""
        return any(self.counts.values())


def total(corrections: Iterable[Correction]) -> dict[str, int]:
    """Counts of the kinds that were met."""
    counts: dict[str, int] = {}
    for correction in corrections:
        for kind, count in correction.counts.items():
            counts[kind] = counts.get(kind, 0) + count
    return {kind: counts[kind] for kind in KINDS if counts.get(kind)}


def without_rows(kind: str, rows: np.ndarray, words: str) -> Correction:
    """The correction that leaves `rows` (m,) out; `words` go on behind their number."""
    return Correction({kind: len(rows)}, f"{len(rows)} row(s) {words}", rows)


def keep_rows(table: Table, keep: np.ndarray) -> Table:
    """The table with the marked rows (n,) alone; columns of another length are left out."""
    return take_rows(table, np.flatnonzero(keep), len(keep))


def take_rows(table: Table, chosen: np.ndarray, n: int) -> Table:
    """The table with the rows `chosen` (m,) of n in this order; columns of another length are left out."""
    complete = [j for j, cells in enumerate(table.columns) if len(cells) == n]
    columns = tuple(cells_at(table.columns[j], chosen) for j in complete)
    distinct_rows = {id(table.rows[j]): table.rows[j] for j in complete}  # most files have one for all columns
    numbers = {key: np.asarray(rows)[chosen] for key, rows in distinct_rows.items()}
    rows: tuple[Any, ...] = tuple(numbers[id(table.rows[j])] for j in complete)
    return replace(table, names=tuple(table.names[j] for j in complete), columns=columns, rows=rows)


def cells_at(cells: Sequence[str] | np.ndarray, chosen: np.ndarray) -> Sequence[str] | np.ndarray:
    """The cells at these places (m,)."""
    if isinstance(cells, Texts):
        return cells.taken(chosen)
    return cells[chosen] if isinstance(cells, np.ndarray) else [cells[k] for k in chosen.tolist()]


def drop_empty_ends(table: Table, columns: list[np.ndarray]) -> tuple[Table, list[np.ndarray], Correction]:
    """Without the rows at both ends in which a channel has no value: there is nothing to fill them from."""
    complete = np.flatnonzero(np.all([np.isfinite(values) for values in columns], axis=0))
    keep = np.ones(len(columns[0]), dtype=bool)
    if len(complete):
        keep[: complete[0]] = keep[complete[-1] + 1 :] = False
    ends = without_rows("ends", np.flatnonzero(~keep), "without values at the ends left out")
    if not ends.needed:
        return table, columns, ends
    return keep_rows(table, keep), [values[keep] for values in columns], ends

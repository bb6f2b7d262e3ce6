"""A table of hand-made columns, as a reader gives it."""

from pathlib import Path

import numpy as np

from sysid.data.table import Table


def table(units: dict[str, str] | None = None, **columns) -> Table:
    """A table of hand-made columns; rows count from 2, below a header."""
    values = tuple(c if isinstance(c, list) else np.asarray(c, dtype=float) for c in columns.values())
    rows = tuple(range(2, len(c) + 2) for c in values)
    return Table(Path("rig.csv"), tuple(columns), values, rows, units=units or {})

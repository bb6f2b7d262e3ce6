"""The free-run fits of several models on one record, as bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Bars, Figure, Panel
from sysid.validation.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(deferred=("axes",))
def comparison(table: Comparison, axes: Axes | None = None) -> Axes:
    """Free-run fit of each model, best on top, with d. A small model as good as a large one is preferable."""
    rows = table.rows
    notes = [
        (f"{r.fit:.2f} %, d {r.criteria.d}" if np.isfinite(r.fit) else "diverges")
        + ("" if r.converged else ", not converged")
        for r in rows
    ]
    bars = Bars(
        [max(r.fit, 0.0) if np.isfinite(r.fit) else 0.0 for r in rows],
        colours=[style.MODEL if r.rank == 1 else style.INPUT for r in rows],
        notes=notes,
    )
    x = Axis("fit [%]", limits=(0.0, 130.0), ticks=range(0, 101, 20))
    panel = Panel([bars], Axis(names=[r.label for r in rows]), x, f"free run on {table.scored} samples")
    return draw(Figure([panel], shared=False, height=0.9 + 0.42 * len(rows)), axes)[0]

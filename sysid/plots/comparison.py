"""The free-run fits of several models on one record, as bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.validation.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def comparison(table: Comparison, axes: Axes | None = None) -> Axes:
    """Free-run fit of each model, best on top, with d. A small model as good as a large one is preferable."""
    rows = table.rows[::-1]
    (ax,) = style.panels(axes, height=0.9 + 0.42 * len(rows))
    shown = [max(r.fit, 0.0) if np.isfinite(r.fit) else 0.0 for r in rows]
    ax.barh(range(len(rows)), shown, color=[style.MODEL if r.rank == 1 else style.INPUT for r in rows], height=0.6)
    for k, r in enumerate(rows):
        text = f"{r.fit:.2f} %, d {r.criteria.d}" if np.isfinite(r.fit) else "diverges"
        ax.text(shown[k] + 1.0, k, text + ("" if r.converged else ", not converged"), va="center", fontsize=8.5)
    ax.set_yticks(range(len(rows)), [r.label for r in rows])
    ax.set(title=f"free run on {table.scored} samples", xlabel="fit [%]", xlim=(0.0, 130.0))
    ax.set_xticks(range(0, 101, 20))
    return ax

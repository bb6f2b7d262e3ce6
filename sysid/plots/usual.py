"""The parts of a joint beside what is usual: what its record adds to the prior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Item, Panel, Ranges, Rule

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Row = tuple[str, tuple[float, float], tuple[float, float]]  # name; centre and deviation before the record, and after it
_WIDE = 1.96  # deviations


@checked(deferred=("axes",))
def usual(rows: Sequence[Row], axes: Sequence[Axes] | None = None) -> list[Axes]:
    """A row for each part: its usual range, and the estimate with its interval, in deviations of what is usual."""
    return draw(usual_figure(rows), axes)


def usual_figure(rows: Sequence[Row], texts: Sequence[str] = ()) -> Figure:
    """The same as a figure; 0 on its axis is a joint without the part, `texts` stand in the hover."""
    items, spreads = list[Item](), np.array([spread for _, (_, spread), _ in rows])
    for k, label, colour in ((1, "usual, 95 %", style.SECOND), (2, "this joint, 95 % interval", style.MODEL)):
        centre, deviation = np.array([row[k] for row in rows]).T / spreads
        half = _WIDE * np.nan_to_num(deviation)
        ends = np.maximum(centre - half, 0.0).tolist(), (centre + half).tolist()
        items.append(Ranges(range(len(rows)), centre.tolist(), *ends, label, texts, colour))
    axis = Axis("size of the part, by the deviation of what is usual [1]")
    panel = Panel([Rule(0.0), *items], Axis(names=[name for name, *_ in rows]), axis)
    return Figure([panel], 1, height=1.2 + 0.4 * len(rows))

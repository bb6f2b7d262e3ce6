"""The parts of a joint beside what is usual: what its record adds to the prior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Item, Panel, Ranges, Rule, Span

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Row = tuple[str, tuple[float, float], tuple[float, float], str]  # name; centre and deviation before and after; verdict
VERDICTS = {  # of sysid.joint.parts, in words, with their colours
    "shown": ("shown by the record", style.MODEL),
    "open": ("not determined", style.SECOND),
    "absent": ("shown to be absent", style.INPUT),
}
_WIDE = 1.96  # deviations


@checked(deferred=("axes",))
def usual(rows: Sequence[Row], axes: Sequence[Axes] | None = None) -> list[Axes]:
    """A row for each part: the estimate with its interval, by the largest usual size; its colour is the verdict."""
    return draw(usual_figure(rows), axes)


def usual_figure(rows: Sequence[Row], texts: Sequence[str] = ()) -> Figure:
    """The same as a figure; 0 on its axis is a joint without the part, `texts` stand in the hover."""
    for *_, verdict in rows:
        if verdict not in VERDICTS:
            raise unknown("verdict on a part", verdict, VERDICTS)
    items: list[Item] = [Span(0.0, 100.0, label="usual, before the record"), Rule(0.0)]
    for verdict, (words, colour) in VERDICTS.items():
        places = [k for k, row in enumerate(rows) if row[3] == verdict]
        if not places:
            continue
        sizes = np.array([rows[k][1][0] + _WIDE * rows[k][1][1] for k in places])
        centre, deviation = 100.0 * np.array([rows[k][2] for k in places]).T / sizes
        half = _WIDE * np.nan_to_num(deviation)
        ends = np.maximum(centre - half, 0.0).tolist(), (centre + half).tolist()
        label = f"{words}, 95 % interval"
        items.append(Ranges(places, centre.tolist(), *ends, label, [texts[k] for k in places if texts], colour))
    names = [f"{name}: {VERDICTS[verdict][0]}" for name, _, _, verdict in rows]
    axis = Axis("size of the part, 0 without it [% of the largest usual size]")
    return Figure([Panel(items, Axis(names=names), axis)], 1, height=1.2 + 0.4 * len(rows), legend="below")

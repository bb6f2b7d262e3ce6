"""The parts of a joint beside what is usual: what its record adds to the prior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.quantities import number
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Panel, Ranges, Rule
from sysid.joint.parts import PartEvidence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDE = 1.96  # deviations
_SHORT = {
    "stick": "stick, upward",
    "stick_down": "stick, downward",
    "loss": "screw's loss",
    "jam": "jam at stops",
    "sag": "sagging supply",
    "width": "backlash",
}


@checked(deferred=("axes",))
def usual(parts: Sequence[PartEvidence], axes: Sequence[Axes] | None = None) -> list[Axes]:
    """A row for each part: its usual range, and the estimate with its interval, in deviations of what is usual."""
    return draw(usual_figure(parts), axes)


def usual_figure(parts: Sequence[PartEvidence]) -> Figure:
    """The same as a figure; 0 on its axis is a joint without the part."""
    places = range(len(parts))

    def scaled(values: Sequence[float]) -> list[float]:
        return [value / part.spread for value, part in zip(values, parts, strict=True)]

    def ends(of: str, deviation: str) -> tuple[list[float], list[float]]:
        rows = [(getattr(p, of), _WIDE * np.nan_to_num(getattr(p, deviation))) for p in parts]
        return scaled([max(c - d, 0.0) for c, d in rows]), scaled([c + d for c, d in rows])

    items = []
    for of, deviation, label, colour in (
        ("usual", "spread", "usual, 95 %", style.SECOND),
        ("value", "std", "this joint, 95 % interval", style.MODEL),
    ):
        low, high = ends(of, deviation)
        x = scaled([getattr(part, of) for part in parts])
        items.append(Ranges(places, x, low, high, label, [_meaning(part) for part in parts], colour))
    names = [_SHORT.get(part.name.split(".")[-1], part.name) for part in parts]
    axis = Axis("size of the part, by the deviation of what is usual [1]")
    return Figure([Panel([Rule(0.0), *items], Axis(names=names), axis)], 1, height=1.2 + 0.4 * len(parts))


def _meaning(part: PartEvidence) -> str:
    """A part in full, for a hover."""
    unit = f" {part.unit}" if part.unit else ""
    return (
        f"<b>{part.words}</b>: {part.verdict}<br>{number(part.value, 4)} ± {number(part.std, 2)}{unit}; usual "
        f"{number(part.usual, 4)} ± {number(part.spread, 2)}{unit}"
    )

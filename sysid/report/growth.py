"""What an actuated joint was tried with, and what stayed: a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.joint.growth import MARGIN, Growth
from sysid.report import style
from sysid.report.page import Picture
from sysid.report.style import styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAMES = {
    "stribeck": "Stribeck",
    "loss": "screw's loss",
    "jams": "jam at stops",
    "screw": "loss and jam",
    "plays": "play",
    "coasts": "coasting play",
}


def picture(growth: Growth | None) -> Picture | None:
    """The parts that were tried; None where none was."""
    if growth is None or not growth.steps:
        return None
    caption = (
        f"Parts tried on the estimation half, round by round: by how much each lowered BIC. Beyond the line, at "
        f"{MARGIN:g}, it earns its place; of each round the best stays (filled), and the next round begins with it. A "
        "bar to the left is a part that costs more than it explains."
    )
    return Picture("growth", style.png(bars(growth)), caption)


@styled
def bars(growth: Growth) -> Figure:
    """A panel a round, a bar a part: the fall of BIC on an axis that is linear about zero and logarithmic beyond."""
    rounds = 1 + max(step.round for step in growth.steps)
    figure, axes = style.sheet(1, rounds, height=2.8)
    for k, ax in enumerate(axes[0]):
        shown = [step for step in growth.steps if step.round == k]
        places = np.arange(len(shown))
        for place, step in zip(places, shown, strict=True):
            colour = style.MODEL if step.kept else "none"
            ax.barh(place, step.earned, 0.6, color=colour, edgecolor=style.MODEL, linewidth=1.0)
        ax.axvline(0, color=style.SECOND, linewidth=0.8)
        ax.axvline(MARGIN, color=style.INK, linewidth=0.8, linestyle="--")
        ax.set_xscale("symlog", linthresh=10.0)
        ax.set_yticks(places, [NAMES[step.part] for step in shown])
        ax.set(title=f"round {k + 1}", xlabel="fall of BIC")
        ax.invert_yaxis()
    return figure

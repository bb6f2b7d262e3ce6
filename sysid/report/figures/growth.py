"""Parts tried and kept in the growth of an actuated joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.style import styled
from sysid.joint.growth import MARGIN
from sysid.joint.pruning import remaining
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.report.joint_words import PARTS
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@styled
def draw(e: Evaluation) -> Sequence[Axes]:
    """One panel per round, one bar per part: the reduction of BIC on a symmetric logarithmic axis."""
    assert e.growth is not None
    steps = e.growth.steps
    row = style.panels(None, 1, 1 + max(step.round for step in steps), height=2.8)
    for k, ax in enumerate(row):
        shown = [step for step in steps if step.round == k]
        places = np.arange(len(shown))
        for place, step in zip(places, shown, strict=True):
            left = remaining((step.part,), e.growth.dropped) if step.kept else ()
            colour, hatch = style.MODEL if left == (step.part,) else "none", "////" if step.kept else ""
            ax.barh(place, step.earned, 0.6, color=colour, hatch=hatch, edgecolor=style.MODEL, linewidth=1.0)
        ax.axvline(0, color=style.SECOND, linewidth=0.8)
        ax.axvline(MARGIN, color=style.INK, linewidth=0.8, linestyle="--")
        ax.set_xscale("symlog", linthresh=10.0)
        ax.set_yticks(places, [PARTS[step.part] for step in shown])
        ax.set(title=f"round {k + 1}", xlabel="fall of BIC")
        ax.invert_yaxis()
    return row


def caption(e: Evaluation) -> str:
    """Explanation of the bars."""
    assert e.growth is not None
    dropped = " A hatched bar is a part that the final joint does without." if e.growth.dropped else ""
    return (
        f"Parts tried on the estimation data, round by round: by how much each lowered BIC. A part is "
        f"kept only if BIC falls by {MARGIN:g} (line) and its free runs over unseen parts get no worse. "
        "The best part of each round (filled) stays in the next round. A "
        f"bar to the left is a part that increases BIC.{dropped}"
    )


def applies(e: Evaluation) -> bool:
    """If parts were tried."""
    return e.growth is not None and bool(e.growth.steps)


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    assert e.growth is not None
    return zoom.growth(e.growth)


FIGURE = ReportFigure("Model", draw, caption, applies, pure=True, zoom=zoomed)

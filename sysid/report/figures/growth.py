"""Parts tried and kept in the growth of an actuated joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.joint.growth import MARGIN
from sysid.plots.earned import earned
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.report.joint_words import bars, hatched
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """One panel per round, one bar per part: the reduction of BIC on a symmetric logarithmic axis."""
    assert e.growth is not None
    return earned(bars(e.growth), MARGIN)


def caption(e: Evaluation) -> str:
    """Explanation of the bars."""
    assert e.growth is not None
    return (
        f"Parts tried on the estimation data, round by round: by how much each lowered BIC. A part is "
        f"kept only if BIC falls by {MARGIN:g} (line) and its free runs over unseen parts get no worse. "
        "The best part of each round (filled) stays in the next round. A "
        f"bar to the left is a part that increases BIC.{hatched(e.growth)}"
    )


def applies(e: Evaluation) -> bool:
    """If parts were tried."""
    return e.growth is not None and bool(e.growth.steps)


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    assert e.growth is not None
    return zoom.growth(e.growth)


FIGURE = ReportFigure("Model", draw, caption, applies, pure=True, zoom=zoomed)

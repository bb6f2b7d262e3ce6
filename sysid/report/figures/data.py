"""The record with its split."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import parts
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Both parts after preprocessing."""
    return parts(e.estimation, e.validation)


def caption(e: Evaluation) -> str:
    """The split of the record."""
    return (
        f"The record as used: the first {e.estimation.N} samples are estimation data, the other {e.validation.N} "
        f"are validation data."
    )


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    return zoom.parts(e.estimation, e.validation)


FIGURE = ReportFigure("Data", draw, caption, zoom=zoomed)

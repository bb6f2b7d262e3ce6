"""The record with its split."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import parts
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Both parts."""
    return parts(e.estimation, e.validation)


def caption(e: Evaluation) -> str:
    """The split of the record."""
    return (
        f"The record as used: the first {e.estimation.N} samples are estimation data, the other {e.validation.N} "
        f"are validation data.{_restored(e)}"
    )


def _restored(e: Evaluation) -> str:
    """What was done to the values that are shown."""
    if not (e.estimation.u_offset.any() or e.estimation.y_offset.any()):
        return ""
    return " Constants that were removed before the fit are added again, here and in the figures of the output."


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    return zoom.parts(e.estimation, e.validation)


FIGURE = ReportFigure("Data", draw, caption, zoom=zoomed)

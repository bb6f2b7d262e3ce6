"""The record as it was used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import parts
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Both parts after preprocessing."""
    return parts(e.estimation, e.validation)


def caption(e: Evaluation) -> str:
    """How the record was split."""
    return (
        f"The record as it was used: the first {e.estimation.N} samples for estimation, the other {e.validation.N} "
        "for validation."
    )


FIGURE = ReportFigure("Data", draw, caption)

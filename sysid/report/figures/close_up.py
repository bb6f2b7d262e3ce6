"""First peaks of the validation data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import close_ups
from sysid.report.figures._figure import VALIDATION_TIME, ReportFigure
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """The first upper and the first lower peak."""
    return close_ups(e.validation, e.validation_output, time=VALIDATION_TIME)


def caption(e: Evaluation) -> str:
    """What it is."""
    return "Close-up of the first whole upper and lower peak of the validation data."


FIGURE = ReportFigure("Model output", draw, caption)

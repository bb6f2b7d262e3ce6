"""Measured output and free-run simulation of both parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import Run, free_run
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Both parts, the validation error, and the one-step-ahead prediction if the model has one."""
    one = e.one_step
    return free_run(
        Run(e.estimation, e.estimation_output, e.estimation_fit),
        Run(e.validation, e.validation_output, e.validation_fit),
        None if one is None else Run(e.validation, one.validation_output, one.validation_fit),
    )


def caption(e: Evaluation) -> str:
    """The data used by the free run."""
    one = " The last panel is a one-step-ahead prediction, not a free run: it uses the previous measured outputs."
    return (
        f"Measured output and the model's free-run simulation. It uses only the input and the first {e.fit.n_init} "
        f"outputs of each part for the initial state; these outputs are not scored.{one if e.one_step else ''}"
    )


FIGURE = ReportFigure("Model output", draw, caption, zoom=zoom.free_run)

"""Measured output and free run over both parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import Run, free_run
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Both parts, the validation error, and one step ahead where the model runs so."""
    one = e.one_step
    return free_run(
        Run(e.estimation, e.estimation_output, e.estimation_fit),
        Run(e.validation, e.validation_output, e.validation_fit),
        None if one is None else Run(e.validation, one.validation_output, one.validation_fit),
    )


def caption(e: Evaluation) -> str:
    """What the free run sees."""
    one = " The last panel is no free run: each sample there is foretold from the measured ones before it."
    return (
        f"Measured output and the model's free run: only the input is used, and the first {e.fit.n_init} outputs of "
        f"each part for the initial state; these are not scored.{one if e.one_step else ''}"
    )


FIGURE = ReportFigure("Model output", draw, caption)

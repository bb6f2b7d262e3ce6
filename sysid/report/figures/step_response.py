"""Step response of the tangent linear model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.base.units import number
from sysid.plots import step
from sysid.report.figures._figure import ReportFigure, signals
from sysid.uncertainty.intervals import Band
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Axes:
    """The response in display units."""
    assert e.step is not None
    y = e.validation.y_name
    return step(Band.bare(e.step.x, e.step.y), None, e.estimation.y_unit, e.estimation.u_unit, y)


def caption(e: Evaluation) -> str:
    """Where it ends."""
    assert e.step is not None
    u, y = signals(e)
    last = float(e.step.y[-1]) * y.per(u).factor
    return (
        "Step response of the linear model that is tangent to the fit at the mean input: after "
        f"{e.step.x[-1]:.3g} s its value is {number(last, 3)} {y.unit or 'units of y'} per {u.unit or 'unit of u'}."
    )


def applies(e: Evaluation) -> bool:
    """If the tangent model has a finite response."""
    return e.step is not None


FIGURE = ReportFigure("Model", draw, caption, applies)

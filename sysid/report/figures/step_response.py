"""Step response of the tangent linear model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.base.units import number
from sysid.plots import step
from sysid.report import zoom
from sysid.report.bands import bands
from sysid.report.figures._figure import ReportFigure, signals
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Axes:
    """The response in display units."""
    response = bands(e).step
    assert response is not None
    return step(response, None, e.estimation.y_unit, e.estimation.u_unit, e.validation.y_name)


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    response = bands(e).step
    assert response is not None
    return zoom.step(response, e.estimation.y_unit, e.estimation.u_unit, e.validation.y_name)


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


FIGURE = ReportFigure("Model", draw, caption, applies, zoom=zoomed)

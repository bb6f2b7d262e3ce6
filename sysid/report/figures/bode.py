"""Frequency response of the tangent linear model, with its band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid import plots
from sysid.report import zoom
from sysid.report.bands import bands
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Magnitude over phase."""
    response = bands(e).frequency
    assert response is not None
    return plots.bode(response, y_unit=e.estimation.y_unit, u_unit=e.estimation.u_unit)


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    response = bands(e).frequency
    assert response is not None
    return zoom.bode(response, e.estimation.y_unit, e.estimation.u_unit)


def caption(e: Evaluation) -> str:
    """What the band says."""
    return (
        "Frequency response of the linear model that is tangent to the fit at the mean input, with its 95 % band, up "
        "to half the sampling frequency. The band is wide where the input of the record has little power."
    )


def applies(e: Evaluation) -> bool:
    """If the record gives a band."""
    return bands(e).frequency is not None


FIGURE = ReportFigure("Model", draw, caption, applies, zoom=zoomed)

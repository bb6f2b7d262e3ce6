"""Frequency response of the tangent linear model, with its band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.plots import bode
from sysid.report import zoom
from sysid.report.bands import bands
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Magnitude over phase."""
    response = bands(e).frequency
    assert response is not None
    return bode(response, y_unit=e.estimation.y_unit, u_unit=e.estimation.u_unit)


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    response = bands(e).frequency
    assert response is not None
    return zoom.bode(response, e.estimation.y_unit, e.estimation.u_unit)


def caption(e: Evaluation) -> str:
    """What the band says."""
    response = bands(e).frequency
    assert response is not None
    low, high = response.magnitude.lower, response.magnitude.upper
    unknown = np.mean(~(np.isfinite(low) & np.isfinite(high) & (high < 10.0 * low)))
    doubt = f" At {100 * unknown:.0f} % of the frequencies shown it is wider than a factor of 10: the record does not "
    doubt += "determine the response there."
    what = "Frequency response of the linear model that is tangent to the fit at the mean input"
    if not np.any(np.isfinite(low) & np.isfinite(high)):
        return f"{what}, up to half the sampling frequency. The record does not bound the magnitude: it has no band."
    return (
        f"{what}, with its 95 % band, up to half the sampling frequency. The band is wide where the input of the "
        "record has little power." + (doubt if unknown > 0.005 else "")
    )


def applies(e: Evaluation) -> bool:
    """If the record gives a band."""
    return bands(e).frequency is not None


FIGURE = ReportFigure("Model", draw, caption, applies, zoom=zoomed)

"""Figures of plotly for pages that are not yet described by `sysid.drawing`."""

from collections.abc import Mapping

import numpy as np

from sysid.data.record import IOData
from sysid.diagnosis.residuals import ResidualTests
from sysid.drawing.plotly import Plotly, plotly
from sysid.drawing.traces import AREAS
from sysid.plots.free_runs import runs_figure
from sysid.plots.records import lines_figure, record_figure
from sysid.plots.residual_tests import residuals_figure

BOUND = AREAS["#dbe7ee"]
Figure = Plotly


def record(data: IOData) -> Plotly:
    """Inputs over outputs."""
    return plotly(record_figure(data))


def runs(data: IOData, models: Mapping[str, np.ndarray], measured: str = "measured") -> Plotly:
    """Outputs of several models over one record."""
    return plotly(runs_figure(data, models, measured))


def lines(t: np.ndarray, signals: Mapping[str, np.ndarray], name: str, unit: str = "", title: str = "") -> Plotly:
    """Signals of one kind in one panel."""
    return plotly(lines_figure(t, signals, name, unit, title))


def residual_tests(tests: ResidualTests) -> Plotly:
    """Correlations of residuals."""
    return plotly(residuals_figure(tests))

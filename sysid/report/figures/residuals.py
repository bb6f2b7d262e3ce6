"""Residual tests with their results in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import residual_tests
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.report.words import one_step, tests_in_words
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation) -> Sequence[Axes]:
    """Correlations of the validation residuals with themselves and with the input."""
    assert e.tests is not None
    return residual_tests(e.tests)


def caption(e: Evaluation) -> str:
    """Both test results and their meaning."""
    assert e.tests is not None
    which = "one step ahead" if one_step(e) else "of the free run"
    return (
        f"Tests of the validation residuals {which}. {tests_in_words(e)} "
        f"A complete model leaves only noise and stays inside the {e.tests.level:.0%} bounds."
    )


def applies(e: Evaluation) -> bool:
    """If the validation part is long enough."""
    return e.tests is not None


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    assert e.tests is not None
    return zoom.residual_tests(e.tests)


FIGURE = ReportFigure("Residual tests", draw, caption, applies, zoom=zoomed)

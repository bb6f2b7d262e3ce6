"""Correlations of residuals and their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.checks import checked
from sysid.diagnosis.residuals import HigherOrderTests, ResidualTests
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Panel, Rule, Span, Stems

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(deferred=("axes",))
def residual_tests(tests: ResidualTests, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Whiteness and independence. Red bars at small positive lags: missing dynamics or delay."""
    return draw(residuals_figure(tests), axes)


@checked(deferred=("axes",))
def higher_order_tests(tests: HigherOrderTests, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Three correlations that are zero for a complete model. Red bars: it is incomplete, see `advice`."""
    panels = [
        _panel(t.lags, t.correlation, t.bound, t.level, t.passed, f"{t.name}: {'passed' if t.passed else 'failed'}")
        for t in tests.tests
    ]
    return draw(Figure(panels, height=6.4), axes)


def residuals_figure(tests: ResidualTests) -> Figure:
    """Residuals with themselves over residuals with the input, each over lags of its own."""
    white, independent = tests.verdicts
    title, cross_title = f"residuals with themselves: {white}", f"residuals with the input; {independent}"
    # Lag 0 of the residuals with themselves is 1 by definition.
    auto = _panel(tests.lags[1:], tests.autocorrelation[1:], tests.whiteness_bound, tests.level, tests.white, title)
    bound, passed = tests.independence_bound, tests.independent
    cross = _panel(tests.cross_lags, tests.cross_correlation, bound, tests.level, passed, cross_title)
    if passed and tests.independence_outside:  # the words judge all lags together, the area one of them
        note = f"{tests.independence_outside} lags leave the bound of one lag: neighbours do so together, within chance"
        cross = replace(cross, note=note)
    constant = tests.autocorrelation.any() and not tests.cross_correlation.any()  # input
    return Figure([auto] if constant else [auto, cross], shared=False, height=2.6 if constant else 4.6, lettered=True)


def _panel(lags: np.ndarray, r: np.ndarray, bound: float, level: float, passed: bool, title: str) -> Panel:
    """Correlations over their lags [samples], with the bound for one of them.

    Where the test failed, those outside the bound stand out; all of them where only all together are too large.
    """
    outside = (np.abs(r) > bound) & (not passed)
    limit = bound if np.isfinite(bound) else 0.0
    bottom, top = (1.25 * max(float((sign * r).max(initial=0.0)), limit, 1e-9) for sign in (-1.0, 1.0))
    area = Span(-limit, limit, upright=False, label=f"{100 * level:g} % bound for one lag")
    y = Axis("correlation [1]", "correlation", limits=(-bottom, top))
    x = Axis("lag [samples]", limits=(min(0.0, float(lags[0]) - 0.5), float(lags[-1]) + 0.5) if len(lags) else None)
    stems = Stems(lags, r, bound, outside if passed or outside.any() else ~outside)
    return Panel([area, stems, Rule(0.0, upright=False)], y, x, title)

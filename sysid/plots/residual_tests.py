"""Correlations of residuals and their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.diagnosis.higher_order import HigherOrderTests
from sysid.diagnosis.residuals import ResidualTests

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def residual_tests(tests: ResidualTests, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Whiteness and independence. Bars outside the bound at small positive lags: missing dynamics or delay."""
    both = style.panels(axes, 2, height=4.2)
    # Lag 0 of the residuals with themselves is 1 by definition.
    _lags(both[0], tests.lags[1:], tests.autocorrelation[1:], tests.whiteness_bound, tests.level)
    _lags(both[1], tests.cross_lags, tests.cross_correlation, tests.independence_bound, tests.level)
    white, independent = tests.verdicts
    both[0].set(title=f"(a) residuals with themselves: {white}")
    both[1].set(title=f"(b) residuals with the input; {independent}", xlabel="lag [samples]")
    return both


@checked(own=("axes",))
@styled
def higher_order_tests(tests: HigherOrderTests, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Three correlations that are zero for a complete model. Bars outside: the model is incomplete, see `advice`."""
    rows = style.panels(axes, len(tests.tests), height=6.4, sharex=True)
    for ax, t in zip(rows, tests.tests, strict=True):
        _lags(ax, t.lags, t.correlation, t.bound, t.level)
        ax.set(title=f"{t.name}: {'passed' if t.passed else 'failed'}")
    rows[-1].set(xlabel="lag [samples]")
    return rows


def _lags(ax: Axes, lags: np.ndarray, r: np.ndarray, bound: float, level: float) -> None:
    limit = bound if np.isfinite(bound) else 0.0
    ax.axhspan(-limit, limit, color=style.BOUND, lw=0, zorder=0, label=f"{100 * level:g} % bound for one lag")
    outside = np.abs(r) > bound
    for chosen, colour, name in ((~outside, style.INK, None), (outside, style.MODEL, "outside")):
        if chosen.any():
            ax.vlines(lags[chosen], 0.0, r[chosen], color=colour, linewidth=1.2)
            ax.plot(lags[chosen], r[chosen], "o", color=colour, markersize=3, label=name)
    ax.axhline(0.0, color=style.SECOND, linewidth=0.8)
    below, above = (max(float((sign * r).max(initial=0.0)), limit, 1e-9) for sign in (-1.0, 1.0))
    ax.set(ylabel="correlation", ylim=(-1.25 * below, 1.25 * above))
    style.legend(ax)

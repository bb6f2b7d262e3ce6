"""Logarithmic axes, whose numbers are plain text.

Matplotlib writes powers of ten as formulas, and figures of ours show no formula: a channel may be called $_{.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def log_axis(axes: Axes, which: str = "xy", linear_below: float | None = None) -> None:
    """Makes the axes named in `which`, "x", "y" or "xy", logarithmic.

    With `linear_below`, an axis that is linear between -linear_below and linear_below, and logarithmic outside.
    """
    formatter = _formatter()
    for each, scaled in (("x", axes.set_xscale), ("y", axes.set_yscale)):
        if each not in which:
            continue
        if linear_below is None:
            scaled("log")
        else:
            scaled("symlog", linthresh=linear_below)
        axis = axes.xaxis if each == "x" else axes.yaxis
        axis.set_major_formatter(formatter(linthresh=linear_below))
        axis.set_minor_formatter(formatter(linthresh=linear_below, minor_thresholds=(1.0, 0.4)))


def power(value: float) -> str:
    """A number at a tick: 0.1, 20, 1000, and 1e5 or 2e−4 where zeros would have to be counted."""
    text = f"{value:g}"
    if value and not 1e-3 * (1 - 1e-9) <= abs(value) < 1e5:
        mantissa, exponent = f"{value:.3e}".split("e")
        text = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    return text.replace("-", "−")


@cache
def _formatter() -> Any:
    from matplotlib.ticker import LogFormatter

    class Plain(LogFormatter):
        """Matplotlib chooses which ticks have a number, as it does for a formula."""

        def __call__(self, x, pos=None):
            return power(x) if super().__call__(x, pos) else ""

    return Plain

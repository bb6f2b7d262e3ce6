"""Shared parts of figures with uncertainty: the shaded interval, its name and its warning."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def shade(
    axes: Axes, x: np.ndarray, lower: np.ndarray, upper: np.ndarray, label: str, note: str, **kwargs: Any
) -> None:
    """The area between two curves (n,) where both are finite, and an optional note in small letters."""
    known = np.isfinite(lower) & np.isfinite(upper)
    if known.any():
        axes.fill_between(x, lower, upper, where=known, color=style.MODEL, alpha=0.25, lw=0, label=label, **kwargs)
    if note:
        axes.text(0.01, 0.02, note, transform=axes.transAxes, fontsize=7.5, color=style.SECOND, wrap=True)


def level_name(level: float) -> str:
    """A level as text: 95 % band."""
    return f"{100 * level:g} % band"

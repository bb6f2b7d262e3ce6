"""Shared parts of figures with uncertainty: the shaded interval, its name and its warning."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import style
from sysid.uncertainty.information import UNEXCITED

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def shade(
    axes: Axes, x: np.ndarray, lower: np.ndarray, upper: np.ndarray, label: str, note: str, **kwargs: Any
) -> None:
    """The area between two curves (n,) where both are finite, and an optional note in small letters."""
    known = np.isfinite(lower) & np.isfinite(upper)
    if has_area(lower, upper):
        axes.fill_between(x, lower, upper, where=known, color=style.MODEL, alpha=0.25, lw=0, label=label, **kwargs)
    if note:
        said = "the record does not excite all of this curve: no band there" if note == UNEXCITED else note
        axes.text(0.01, 0.02, said, transform=axes.transAxes, fontsize=7.5, color=style.SECOND, wrap=True)


def has_area(lower: np.ndarray, upper: np.ndarray) -> bool:
    """Whether something is to be seen between two curves (n,): samples that stand alone or have no width are not."""
    seen = np.isfinite(lower) & np.isfinite(upper)
    seen[seen] = upper[seen] > lower[seen]
    return bool((seen[1:] & seen[:-1]).any())


def level_name(level: float) -> str:
    """A level as text: 95 % band."""
    return f"{100 * level:g} % band"

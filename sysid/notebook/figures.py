"""Figures for a person: drawn by `sysid.plots`, with one sentence below that says what to see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

from sysid.base import style
from sysid.base.windows import for_a_person

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 125  # letters of the sentence on a line


def figure(draw: Callable[..., Axes | Sequence[Axes]], *given: Any, say: str = "", **options: Any) -> Figure:
    """The figure that `draw` makes of what it is given, and the sentence `say` below it."""
    with for_a_person():
        axes = draw(*given, **options)
    first: Any = axes[0] if isinstance(axes, Sequence) else axes
    made: Figure = first.figure
    if say:
        made.supxlabel(fill(say, _COLUMNS), fontsize=8.0, color=style.SECOND, x=0.01, ha="left")
    return made

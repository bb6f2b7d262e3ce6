"""By how much each part that was tried lowered BIC in the growth of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.log_axes import log_axis
from sysid.base.style import styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Bar = tuple[str, float, bool, bool]  # name of the part, fall of BIC, kept in its round, still in the final joint
LINEAR = 10.0  # [BIC] below which a fall is drawn to scale


@checked(own=("axes",))
@styled
def earned(rounds: Sequence[Sequence[Bar]], margin: float, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """One panel for each round: a bar to the right of the dashed line earned its place, and the filled one stayed.

    A hatched bar is a part that was kept in its round and dropped at the end.
    """
    row = style.panels(axes, 1, max(len(rounds), 1), height=2.8)
    for k, (ax, bars) in enumerate(zip(row, rounds, strict=False)):
        places = np.arange(len(bars))
        for place, (_, fall, kept, stayed) in zip(places, bars, strict=True):
            colour, hatch = style.MODEL if stayed else "none", "////" if kept else ""
            ax.barh(place, fall, 0.6, color=colour, hatch=hatch, edgecolor=style.MODEL, linewidth=1.0)
        ax.axvline(0, color=style.SECOND, linewidth=0.8)
        ax.axvline(margin, color=style.INK, linewidth=0.8, linestyle="--")
        log_axis(ax, "x", LINEAR)
        ax.set_yticks(places, [name for name, *_ in bars])
        ax.set(title=f"round {k + 1}", xlabel=f"fall of BIC, logarithmic beyond {LINEAR:g}")
        ax.invert_yaxis()
    return row

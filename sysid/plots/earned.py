"""By how much each part that was tried lowered BIC in the growth of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.style import styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Bar = tuple[str, float, bool]  # name of the part, fall of BIC, whether it stayed


@styled
def earned(rounds: Sequence[Sequence[Bar]], margin: float, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """One panel for each round: a bar to the right of the dashed line earned its place, and the filled one stayed."""
    row = style.panels(axes, 1, max(len(rounds), 1), height=2.8)
    for k, (ax, bars) in enumerate(zip(row, rounds, strict=False)):
        places = np.arange(len(bars))
        for place, (_, fall, kept) in zip(places, bars, strict=True):
            ax.barh(place, fall, 0.6, color=style.MODEL if kept else "none", edgecolor=style.MODEL, linewidth=1.0)
        ax.axvline(0, color=style.SECOND, linewidth=0.8)
        ax.axvline(margin, color=style.INK, linewidth=0.8, linestyle="--")
        ax.set_xscale("symlog", linthresh=10.0)
        ax.set_yticks(places, [name for name, *_ in bars])
        ax.set(title=f"round {k + 1}", xlabel="fall of BIC")
        ax.invert_yaxis()
    return row

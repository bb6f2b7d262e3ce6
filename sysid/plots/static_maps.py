"""Static maps: one with its band, or all of a chain side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.base.units import shown
from sysid.plots._shade import level_name, shade
from sysid.uncertainty.curves import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Words = tuple[str, str, str]  # title, signal before the map, signal after it


@checked(own=("axes",))
@styled
def static_curve(curve: Curve, axes: Axes | None = None, words: Words | None = None) -> Axes:
    """One static map with its band; the band is wide where the record has few samples.

    On the normalised scale the dashed diagonal is the linear map; on a map's own scale there is no diagonal. `words`
    replace the title and the axis labels.
    """
    (ax,) = style.panels(axes, height=4.0)
    _draw(ax, curve, words or words_of(curve))
    return ax


@checked(own=("axes",))
@styled
def static_maps(
    curves: Sequence[Curve], axes: Sequence[Axes] | None = None, words: Mapping[str, Words] | None = None
) -> list[Axes]:
    """Every map of a chain, in the order of the signal; `words` by role."""
    row = style.panels(axes, 1, len(curves), height=2.8)
    for ax, curve in zip(row, curves, strict=True):
        _draw(ax, curve, (words or {}).get(curve.role, words_of(curve)))
    return row


@checked(own=("axes",))
def words_of(curve: Curve) -> Words:
    """Title and labels of a map by its role and scale."""
    before = "u" if curve.role == "input" else "signal before the map"
    after = "y" if curve.role == "output" else "signal after the map"
    return f"{curve.role} map, {curve.scale} scale", before, after


def _draw(ax: Axes, curve: Curve, words: Words) -> None:
    b, (title, before, after) = curve.band, words
    x, y = shown(before, curve.x_unit), shown(after, curve.y_unit)
    ax.plot(b.x * x.factor, b.value * y.factor, color=style.MODEL, label=f"{curve.role} map")
    shade(ax, b.x * x.factor, b.lower * y.factor, b.upper * y.factor, level_name(b.level), b.note)
    if curve.scale == "normalised":
        ends = np.array([b.x[0], b.x[-1]])
        ax.plot(ends * x.factor, ends * y.factor, "--", color=style.SECOND, lw=1, label="no nonlinearity")
    ax.set(title=title, xlabel=x.label, ylabel=y.label)
    # A band that is wide where the record has few samples must not squeeze the curve into a line.
    low, high = float(b.value.min()) * y.factor, float(b.value.max()) * y.factor
    bottom, top = ax.get_ylim()
    width = (high - low) or 1.0
    ax.set_ylim(max(bottom, low - width), min(top, high + width))
    if len(ax.get_legend_handles_labels()[0]) > 1:
        ax.legend()

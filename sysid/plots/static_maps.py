"""Static maps: one with its band, or all of a chain side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.quantities import display_quantity
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Line, Panel
from sysid.plots.responses import curve_items, in_small, note_sentences
from sysid.uncertainty.curves import NORMALISED, Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Words = tuple[str, str, str]  # title, signal before the map, signal after it


@checked(deferred=("axes",))
def static_curve(curve: Curve, axes: Axes | None = None, words: Words | None = None) -> Axes:
    """One static map with its band; the band is wide where the record has few samples.

    On the normalised scale the dashed diagonal is the linear map; on a map's own scale there is no diagonal. `words`
    replace the title and the axis labels.
    """
    return draw(Figure([_panel(curve, words or words_of(curve))], shared=False, height=4.0), axes)[0]


@checked(deferred=("axes",))
def static_maps(
    curves: Sequence[Curve], axes: Sequence[Axes] | None = None, words: Mapping[str, Words] | None = None
) -> list[Axes]:
    """Every map of a chain, in the order of the signal; `words` by role."""
    return draw(maps_figure(curves, words), axes)


def maps_figure(curves: Sequence[Curve], words: Mapping[str, Words] | None = None) -> Figure:
    """Every map of a chain beside the others; `words` by role."""
    panels = [_panel(curve, (words or {}).get(curve.role) or words_of(curve)) for curve in curves]
    sentences = [text for curve in curves for text in note_sentences(f"all of the {curve.role} map", curve.band.note)]
    return Figure(panels, len(panels), shared=False, height=3.3, legend="above", said=sentences)


@checked(deferred=("axes",))
def words_of(curve: Curve) -> Words:
    """Title and labels of a map by its role and scale."""
    x_name = "u" if curve.role == "input" else "signal before the map"
    y_name = "y" if curve.role == "output" else "signal after the map"
    return f"{curve.role} map, {curve.scale} scale", x_name, y_name


def _panel(curve: Curve, words: Words) -> Panel:
    """A map over its signal."""
    b, (title, x_name, y_name) = curve.band, words
    x, y = display_quantity(x_name, curve.x_unit), display_quantity(y_name, curve.y_unit)
    items = curve_items(b, "map", x.factor, y.factor)
    if curve.scale == NORMALISED:
        ends = np.array([b.x[0], b.x[-1]])
        items.append(Line(ends * x.factor, ends * y.factor, "no nonlinearity", style.SECOND, 1.0, dash=True))
    return Panel(items, Axis.of(y, _limits(curve, y.factor)), Axis.of(x), title, note=in_small(b.note))


def _limits(curve: Curve, factor: float) -> tuple[float, float] | None:
    """Limits where the band is so wide, for few samples, that it would squeeze the curve into a line."""
    b = curve.band
    low, high = float(b.value.min()) * factor, float(b.value.max()) * factor
    edges = np.concatenate([b.lower, b.upper]) * factor
    edges = edges[np.isfinite(edges)]
    width = (high - low) or 1.0
    if not len(edges) or (edges.min() >= low - width and edges.max() <= high + width):
        return None
    return max(float(edges.min()) - 0.05 * width, low - width), min(float(edges.max()) + 0.05 * width, high + width)

"""A title and the legend beside it: both stand above the axes, the title on the left, the legend on the right.

Where they do not fit into one line, the title goes above the legend; a legend wider than its axes gets fewer columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4
GAP = 6.0  # [point] between title and legend
ABOVE = 5.0  # [point] between a legend and the title above it
_OURS = "legend above the axes"


def legend_above(axes: Axes, *named: Any, ncols: int = COLUMNS, **kwargs: Any) -> None:
    """A legend above the axes on the right; `named` are handles and labels, those of the axes if not given."""
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    axes.legend(*named, ncols=ncols, handlelength=1.6, **place, **kwargs).set_gid(_OURS)


def make_room(figure: Figure) -> None:
    """Moves titles off legends, before the figure is drawn; call it within the house style."""
    crowded = [axes for axes in figure.axes if _ours(axes) is not None and _crowded(axes)]
    if not crowded:
        return  # most figures: places are known only after the layout, which takes as long as drawing
    figure.draw_without_rendering()
    for axes in crowded:
        _fit(axes)
        if _crowded(axes):
            height = _ours(axes).get_window_extent().height * 72.0 / figure.dpi
            axes.set_title(_title(axes).get_text(), loc="left", pad=height + ABOVE)


def _fit(axes: Any) -> None:
    """Fewer columns, until the legend is no wider than its axes."""
    legend = _ours(axes)
    names = [text.get_text() for text in legend.get_texts()]
    for columns in range(min(COLUMNS, len(names)) - 1, 0, -1):
        if legend.get_window_extent().width <= axes.bbox.width:
            return
        legend_above(axes, legend.legend_handles, names, ncols=columns)
        legend = _ours(axes)


def _ours(axes: Any) -> Any:
    legend = axes.get_legend()
    return legend if legend is not None and legend.get_gid() == _OURS else None


def _crowded(axes: Any) -> bool:
    title = _title(axes)
    beside = title.get_window_extent().width + GAP * axes.figure.dpi / 72.0 if title.get_text() else 0.0
    return bool(beside + _ours(axes).get_window_extent().width > axes.bbox.width)


def _title(axes: Any) -> Any:
    """The house style has titles on the left."""
    return axes._left_title

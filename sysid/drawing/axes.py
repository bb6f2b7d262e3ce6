"""A figure as axes of matplotlib, which is imported when something is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import style
from sysid.base.errors import readable
from sysid.base.style import log_axis
from sysid.drawing.departure import spread_axis
from sysid.drawing.figure import (
    DOTTED,
    Band,
    Bars,
    Figure,
    Histogram,
    Line,
    Panel,
    Points,
    Ranges,
    Region,
    Rule,
    Span,
    Stems,
    View,
    has_area,
    with_text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LETTERS = "abcdefghijklmnopqrstuvwxyz"
MARKS = {"dot": "o", "cross": "x", "ring": "o", "plus": "+", "up": "^", "down": "v"}
DASHES = {"solid": "-", "dot": ":", "dash": "--"}
SMALL = 7.5  # letters of a note [point]
GROUND = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.5}  # of words, under which no curve runs
LETTER = 0.07  # width of a letter of a label [inch]


@style.styled
def draw(figure: Figure, axes: Axes | Sequence[Axes] | None = None) -> list[Axes]:
    """The figure in the given axes, one for each panel or view, or in a new sheet; returns the axes.

    Raises InputError for another number of axes than there are panels.
    """
    figure = with_text(figure, readable)
    shown = [(panel, view) for panel in figure.panels for view in panel.views or (None,)]
    columns = min(max(figure.columns, max((len(p.views) for p in figure.panels), default=1)), max(len(shown), 1))
    rows = -(-len(shown) // columns)
    sharex = figure.shared and rows > 1
    heights = _heights(figure, rows)
    found = style.panels(axes, rows, columns, figure.height, sharex, heights, len(shown))
    for k, (ax, (panel, view)) in enumerate(zip(found, shown, strict=True)):
        for item in [*panel.items, *(mark if k == 0 else replace(mark, label="") for mark in figure.marks)]:
            _DRAW[type(item)](ax, item)
        title = view.title if view is not None else panel.title
        lettered = figure.lettered and len(shown) > 1
        ax.set_title(f"({LETTERS[k % 26]}) {title}" if lettered else title)
        if not figure.shared or k >= len(shown) - columns:
            ax.set_xlabel(panel.x.label)
        if k % columns == 0 or len(figure.panels) > 1:
            ax.set_ylabel(_wrapped(panel.y.label, figure.height * heights[k // columns] / sum(heights)))
        _set_axes(ax, panel, view)
        if figure.legend == "panels" and ax.get_legend_handles_labels()[0]:
            style.legend(ax)
    for mark in figure.marks:
        if isinstance(mark, Rule) and mark.sides is not None:
            _draw_sides(found[0], mark.at, mark.sides)
    if figure.legend in ("above", "below"):
        _draw_common_legend(found[0], figure.legend, axes is None)
    return found


def _draw_sides(ax: Axes, at: float, sides: tuple[str, str]) -> None:
    """The words on both sides of a line through all panels, in the first one, with room for them over its data."""
    scale = ax.yaxis.get_transform()
    bottom, top = scale.transform(np.array(ax.get_ylim()))
    ax.set_ylim(top=float(scale.inverted().transform(top + 0.08 * (top - bottom))))
    place: dict[str, Any] = {"xycoords": ax.get_xaxis_transform(), "textcoords": "offset points", "va": "top"}
    for words, side in zip(sides, ("right", "left"), strict=True):
        ax.annotate(words, (at, 1.0), (-4 if side == "right" else 4, -2), ha=side, fontsize=SMALL, **place)


def _wrapped(label: str, height: float) -> str:
    """A label beside axes of a `height` [inch], in lines that are no longer: two of the name, then the unit."""
    letters = max(int((height - 0.5) / LETTER), 8)
    if len(label) <= letters:
        return label
    name, bracket, unit = label.rpartition(" [")
    lines = wrap(name, letters, max_lines=2, placeholder=" …", break_long_words=False)
    unit = f"{bracket}{unit}".strip()
    if lines and len(lines[-1]) + len(unit) < letters:
        return "\n".join([*lines[:-1], f"{lines[-1]} {unit}"])
    return "\n".join([*lines, *wrap(unit, letters, break_long_words=False)])


def _heights(figure: Figure, rows: int) -> list[float]:
    """The relative height of every row."""
    return [panel.weight for panel in figure.panels] if rows == len(figure.panels) else [1.0] * rows


def _set_axes(ax: Axes, panel: Panel, view: View | None) -> None:
    """Scales, limits, names at the ticks, and the note."""
    from matplotlib.ticker import MaxNLocator

    note = panel.note
    if view is not None:
        ax.set(xlim=view.x, ylim=view.y)
        note = note or view.note
    for which, axis in (("x", panel.x), ("y", panel.y)):
        if axis.log:
            log_axis(ax, which)
        if axis.limits is not None and view is None:
            (ax.set_xlim if which == "x" else ax.set_ylim)(*axis.limits)
        if axis.ticks:
            (ax.set_xticks if which == "x" else ax.set_yticks)(list(axis.ticks))
    if panel.equal:
        ax.set_aspect("equal")
        ax.xaxis.set_major_locator(MaxNLocator(5))
    if panel.y.names:
        ax.set_yticks(range(len(panel.y.names)), list(panel.y.names))
        if panel.y.limits is None:
            ax.set_ylim(len(panel.y.names) - 0.4, -0.6)
        if not panel.x.log and panel.x.limits is None:
            ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))  # numbers that are read at once
    if panel.y.near is not None:
        spread_axis(ax, panel.y.near, *_values(panel))
    if panel.x.tight:
        ax.margins(x=0.005)
    if note:
        ax.text(0.01, 0.02, note, transform=ax.transAxes, fontsize=SMALL, color=style.SECOND, bbox=GROUND, wrap=True)


def _values(panel: Panel) -> list[np.ndarray]:
    """What stands in a panel over its vertical axis."""
    lines = [line.y for line in panel.lines()]
    return lines + [edge for item in panel.items if isinstance(item, Band) for edge in (item.lower, item.upper)]


def _draw_common_legend(ax: Axes, side: str, own_sheet: bool) -> None:
    """One legend for all axes of a sheet; that of the first axes where these are somebody else's."""
    if not own_sheet:
        style.legend(ax)
        return
    place = "outside upper center" if side == "above" else "outside lower center"
    figure: Any = ax.figure
    handles: dict[str, Any] = {}
    for ax_of_sheet in figure.axes:
        for handle, label in zip(*ax_of_sheet.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc=place, ncols=5)


def _label(item: Any) -> str | None:
    return (item.label or None) if getattr(item, "key", True) else None


def _line(ax: Axes, item: Line) -> None:
    look: dict[str, Any] = {"marker": ".", "markersize": 3} if item.dots and len(item.x) < DOTTED else {}
    look |= {"linestyle": "--"} if item.dash else {}
    style.line(ax, item.x, item.y, item.steps, color=item.colour, linewidth=item.width, label=_label(item), **look)


def _band(ax: Axes, item: Band) -> None:
    if not has_area(item.lower, item.upper):
        return
    finite = np.isfinite(item.lower) & np.isfinite(item.upper)
    look: dict[str, Any] = {"color": item.colour, "alpha": 0.25, "lw": 0, "label": _label(item)}
    ax.fill_between(item.x, item.lower, item.upper, where=finite, step="post" if item.steps else None, **look)


def _points(ax: Axes, item: Points) -> None:
    if len(item.x):
        look = {"markersize": 3.5} if item.mark == "dot" else {"markersize": 7, "mfc": "none", "mew": 1.5}
        ax.plot(item.x, item.y, MARKS[item.mark], color=item.colour, label=_label(item), **look)


def _region(ax: Axes, item: Region) -> None:
    """An ellipse, or a thick bar on the real axis."""
    from matplotlib.patches import Ellipse

    if item.b == 0.0:
        ends = [item.x - item.a, item.x + item.a]
        ax.plot(ends, [item.y, item.y], color=item.colour, lw=4, alpha=0.35, solid_capstyle="butt")
    else:
        shape: dict[str, Any] = {"angle": np.degrees(item.tilt), "color": item.colour, "alpha": 0.3, "lw": 0}
        ax.add_patch(Ellipse((item.x, item.y), 2 * item.a, 2 * item.b, **shape))
    if item.label and item.label not in ax.get_legend_handles_labels()[1]:
        ax.plot([], [], color=item.colour, lw=4, alpha=0.35, label=item.label)


def _stems(ax: Axes, item: Stems) -> None:
    for group, colour, name in ((~item.stand_out, style.INK, None), (item.stand_out, style.MODEL, "beyond chance")):
        if group.any():
            ax.vlines(item.x[group], 0.0, item.y[group], color=colour, linewidth=1.2)
            ax.plot(item.x[group], item.y[group], "o", color=colour, markersize=3, label=name)


def _bars(ax: Axes, item: Bars) -> None:
    label = _label(item)
    for place, (length, colour) in enumerate(item.rows()):
        ax.barh(place + item.shift, length, item.width, color=colour, edgecolor=colour, label=label)
        label = None
    for place, (length, note) in enumerate(zip(item.lengths, item.notes, strict=False)):
        ax.annotate(note, (length, place + item.shift), (4, 0), textcoords="offset points", va="center", fontsize=8.5)


def _histogram(ax: Axes, item: Histogram) -> None:
    ax.bar(item.edges[:-1], item.counts, np.diff(item.edges), align="edge", color=item.colour)


def _ranges(ax: Axes, item: Ranges) -> None:
    sure = item.low is not None and item.high is not None
    for place, low, high in zip(item.places, item.low or (), item.high or (), strict=False):
        ax.plot([low, high], [place, place], color=item.colour, linewidth=2.0)
    face = item.colour if sure else "none"
    ax.plot(item.x, item.places, "o", color=item.colour, markerfacecolor=face, markersize=4)
    look: dict[str, Any] = {"color": item.colour, "markerfacecolor": face, "markersize": 4, "linewidth": 2.0}
    ax.plot([], [], "o-" if sure else "o", label=item.label or None, **look)
    ax.margins(x=0.15)


def _rule(ax: Axes, item: Rule) -> None:
    look: dict[str, Any] = {"color": item.colour, "linewidth": item.width, "linestyle": DASHES[item.dash]}
    look["zorder"] = 1.5  # over bars, under lines
    (ax.axvline if item.upright else ax.axhline)(item.at, label=item.label or None, **look)


def _span(ax: Axes, item: Span) -> None:
    look: dict[str, Any] = {"color": item.colour, "lw": 0, "zorder": 0, "label": item.label or None}
    look |= {} if item.colour == style.BOUND else {"alpha": 0.15}
    (ax.axvspan if item.upright else ax.axhspan)(item.low, item.high, **look)


_DRAW: dict[type, Any] = {
    Band: _band,
    Bars: _bars,
    Histogram: _histogram,
    Line: _line,
    Points: _points,
    Ranges: _ranges,
    Region: _region,
    Rule: _rule,
    Span: _span,
    Stems: _stems,
}

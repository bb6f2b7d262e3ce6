"""A figure as a plain dictionary of plotly, {"data": [...], "layout": {...}}, which plotly.js draws.

A long line is thinned to its extremes, and its hover says so. The page replaces the colours in the dark.
`layout["meta"]["said"]`, where it is, is a sentence that belongs into the caption; `layout["meta"]["beside"]` is the
number of panels that stand beside each other, which a narrow window puts below each other.
"""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from sysid.base import style
from sysid.base.errors import readable
from sysid.drawing.figure import (
    Axis,
    Bars,
    Figure,
    Panel,
    Rule,
    Span,
    Stems,
    with_text,
)
from sysid.drawing.traces import PAPER, area_fill, traces_of

Plotly = dict[str, Any]
GRID, FRAME = "#e4e7eb", "#9aa5b1"
ROW, NAMED = 160, 30  # height of a panel, and of a name in a panel of names [px]
BESIDE = 220  # height of panels that stand beside each other [px]
SQUARE = 350  # height of a panel with equal scales [px]
TITLE = 20  # of a title [px]
GAP = 0.12  # between panels beside each other, of the width
LOG = {"type": "log", "tickformat": "~g", "nticks": 5}  # an axis whose ticks have whole numbers as on paper: 0.2, 1, 10
MARGIN = {"l": 62, "r": 14, "t": 62, "b": 48}


def plotly(figure: Figure) -> Plotly:
    """The figure with traces, axes, legend, and buttons where a panel can be seen in several ways."""
    figure = with_text(figure, as_text)
    panels = figure.panels
    columns = len(panels) if figure.columns > 1 and not any(panel.y.names for panel in panels) else 1
    one_axis = figure.shared and columns == 1
    layout = _layout(figure, columns, one_axis)
    hover_over_all = one_axis and any(panel.lines() for panel in panels)
    traces, shapes = list[Plotly](), list[Plotly]()
    for k, panel in enumerate(panels):
        place = {"xaxis": "x" if one_axis else _axis("x", k), "yaxis": _axis("y", k)}
        for item in panel.items:
            if isinstance(item, Rule | Span):
                shapes.append(_shape(item, panel, place))
            else:
                traces += [trace | place for trace in traces_of(item, panel, hover_over_all)]
    layout["annotations"] += [note for mark in figure.marks if isinstance(mark, Rule) for note in _sides(mark)]
    layout["shapes"] = [*shapes, *(_shape(mark, None, {"xaxis": "x", "yaxis": "paper"}) for mark in figure.marks)]
    _name_once([*traces, *layout["shapes"]])
    if hover_over_all:
        layout |= {"hovermode": "x unified", "hoversubplots": "axis"}
    if any(isinstance(item, Stems) for panel in panels for item in panel.items):
        layout |= {"bargap": 0.55, "barmode": "overlay"}
    _add_buttons(layout, panels)
    if figure.said:
        layout["meta"] = {**layout.get("meta", {}), "said": " ".join(dict.fromkeys(figure.said))}
    return {"data": traces, "layout": layout}


def as_text(text: str) -> str:
    """A text for plotly, which would take <b> and %{y} in it for marks of its own."""
    return escape(readable(text), quote=False).replace("%{", "&#37;{")


def base_layout(height: int) -> Plotly:
    """A layout without axes and without colours of its own."""
    return {
        "height": height,
        "margin": dict(MARGIN),
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "font": {"color": style.INK, "size": 12, "family": "system-ui, Segoe UI, DejaVu Sans, sans-serif"},
        "legend": {"orientation": "h", "x": 1, "xanchor": "right", "y": 1.02, "yanchor": "bottom", "bgcolor": PAPER},
        "hoverlabel": {"align": "left"},
        "hovermode": "closest",
        "annotations": [],
        "shapes": [],
        "uirevision": "kept",  # zoom and legend stay when the colours change
    }


def side(label: str, **more: Any) -> Plotly:
    """One axis with its label; the limits are plotly's own and hold everything that is drawn."""
    return {
        "title": {"text": label, "standoff": 8},
        "gridcolor": GRID,
        "linecolor": FRAME,
        "zeroline": False,
        "automargin": True,
        "exponentformat": "power",
        **more,
    }


def _axis(letter: str, k: int) -> str:
    """The name of an axis in a trace: y, y2, ..."""
    return letter if k == 0 else f"{letter}{k + 1}"


def _layout(figure: Figure, columns: int, one_axis: bool) -> Plotly:
    """Axes with their places, and titles; panels below each other, or `beside` of them beside each other."""
    panels, has_titles = figure.panels, any(panel.title for panel in figure.panels)
    gap = (28 if has_titles else 16) if one_axis else (68 if has_titles else 52)
    sizes = [BESIDE] if columns > 1 else [_size(panel) for panel in panels]
    area = sum(sizes) + gap * (len(sizes) - 1)
    layout = base_layout(round(area + MARGIN["t"] + MARGIN["b"]))
    top, wide = 1.0, (1.0 - GAP * (columns - 1)) / columns
    for k, panel in enumerate(panels):
        start = k * (wide + GAP) if columns > 1 else 0.0
        low = 0.0 if columns > 1 else max(top - sizes[k] / area, 0.0)
        x, y = (f"{letter}axis{'' if k == 0 else k + 1}" for letter in "xy")
        layout[y] = _side(panel.y, panel, "y") | {"domain": [low, top]}
        if not one_axis:
            layout[x] = _side(panel.x, panel, "x") | {"domain": [start, start + wide], "anchor": _axis("y", k)}
            layout[y]["anchor"] = _axis("x", k)
            if panel.equal:
                layout[x]["constrain"] = "domain"
                layout[y]["scaleanchor"] = _axis("x", k)
        if panel.title:
            layout["annotations"].append(_title(panel.title, start, top))
        top = 1.0 if columns > 1 else low - gap / area
    if one_axis:
        last = len(panels) - 1
        layout["xaxis"] = _side(panels[last].x, panels[last], "x") | {"anchor": _axis("y", last)}
    if columns > 1:
        layout["meta"] = {"beside": columns}
    if panels[0].title:  # it stands where a narrow legend begins
        layout["margin"]["t"] += TITLE
        layout["height"] += TITLE
        layout["legend"]["y"] = 1.0 + TITLE / area
    return layout


def _size(panel: Panel) -> float:
    """Height of a panel [px]."""
    if panel.y.names:
        return float(24 + NAMED * len(panel.y.names))
    return SQUARE if panel.equal else ROW * panel.weight


def _side(axis: Axis, panel: Panel, letter: str) -> Plotly:
    """One axis of a panel."""
    settings = side(axis.label)
    limits = axis.whole or axis.limits
    if axis.ticks:
        settings["tickvals"] = list(axis.ticks)
    if panel.views and limits is None:
        limits = getattr(panel.views[0], letter)
    if axis.names:
        return settings | {"type": "category", "autorange": "reversed", "categoryarray": list(axis.names)}
    if axis.log:
        settings |= LOG
        limits = None if limits is None else (float(np.log10(limits[0])), float(np.log10(limits[1])))
    if axis.near is not None:
        return settings | {"range": list(axis.near), "autorange": False}
    return settings if limits is None else settings | {"range": list(limits)}


def _title(text: str, x: float, y: float) -> Plotly:
    place = {"xref": "paper", "yref": "paper", "x": x, "y": y, "xanchor": "left", "yanchor": "bottom"}
    return {"text": f"<b>{text}</b>", "showarrow": False, "align": "left", **place}


def _add_buttons(layout: Plotly, panels: Sequence[Panel]) -> None:
    """Buttons for the views of a panel, and for the data or the whole of runs that leave them."""
    data_ranges, free_ranges, options = dict[str, Any](), dict[str, Any](), list[tuple[str, Plotly]]()
    for k, panel in enumerate(panels):
        axis = f"yaxis{'' if k == 0 else k + 1}"
        if panel.y.near is not None:
            data_ranges |= {f"{axis}.range": list(panel.y.near), f"{axis}.autorange": False}
            free_ranges |= {f"{axis}.autorange": True}
        if len(panel.views) > 1:
            first = {"xaxis.range": layout["xaxis"]["range"], "yaxis.range": layout["yaxis"]["range"]}
            changes = [{"xaxis.range": list(v.x), "yaxis.range": list(v.y)} for v in panel.views[1:]]
            options += [(v.title, change) for v, change in zip(panel.views, [first, *changes], strict=True)]
    if data_ranges:
        options = [("near the data", data_ranges), ("whole run", free_ranges)]
        layout["margin"]["t"] += 34
    if options:
        buttons = [{"label": label, "method": "relayout", "args": [change]} for label, change in options]
        place = {"x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom", "pad": {"b": 24 if data_ranges else 4}}
        layout["updatemenus"] = [{"type": "buttons", "direction": "right", "buttons": buttons, **place}]


def _name_once(things: Sequence[Plotly]) -> None:
    """Each name stands in the legend once."""
    names = set[str]()
    for thing in things:
        if thing.get("showlegend"):
            thing["showlegend"] = thing["name"] not in names
            names.add(thing["name"])


def _shape(item: Rule | Span, panel: Panel | None, place: dict[str, str]) -> Plotly:
    """A line or an area across a panel, or across all of them where `place` has no vertical axis."""
    letter, other_letter = ("x", "y") if item.upright else ("y", "x")
    ends = (item.at, item.at) if isinstance(item, Rule) else (item.low, item.high)
    axis = place[f"{other_letter}axis"]
    shape: Plotly = {
        f"{letter}ref": place[f"{letter}axis"],
        f"{other_letter}ref": axis if axis == "paper" else f"{axis} domain",
        f"{letter}0": ends[0],
        f"{letter}1": ends[1],
        f"{other_letter}0": 0,
        f"{other_letter}1": 1,
        "showlegend": bool(item.label),
        **({"name": item.label, "legendgroup": item.label} if item.label else {}),
    }
    if isinstance(item, Rule):
        layer = "above" if panel is None or any(isinstance(i, Bars) for i in panel.items) else "below"
        return shape | {"type": "line", "layer": layer, "line": {"color": item.colour, "width": 1, "dash": item.dash}}
    return shape | area_fill(item.colour) | {"type": "rect", "line": {"width": 0}, "layer": "below"}


def _sides(rule: Rule) -> list[Plotly]:
    """The words on both sides of a line through all panels."""
    if rule.sides is None:
        return []
    place = {"x": rule.at, "xref": "x", "y": 1, "yref": "paper", "yanchor": "bottom", "showarrow": False}
    words = zip((f"{rule.sides[0]} ", f" {rule.sides[1]}"), ("right", "left"), strict=True)
    return [{"text": text, "xanchor": anchor, "font": {"size": 11}, **place} for text, anchor in words]

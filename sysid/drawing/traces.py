"""The items of a panel as traces of plotly: plain dictionaries."""

from typing import Any

import numpy as np

from sysid.base import style
from sysid.drawing.figure import (
    DOTTED,
    Band,
    Bars,
    Histogram,
    Item,
    Line,
    Panel,
    Points,
    Ranges,
    Region,
    Stems,
    has_area,
)

Trace = dict[str, Any]
PAPER = "rgba(0,0,0,0)"  # the page's own colour, light or dark
# Areas shine through; `zoom.js` has the same colours for the dark.
AREAS = {style.MODEL: "rgba(194,65,12,0.22)", style.BOUND: "rgba(47,111,143,0.16)", style.INK: "rgba(31,41,51,0.18)"}
MARKS = {
    "dot": "circle",
    "cross": "x-thin-open",
    "ring": "circle-open",
    "plus": "cross-thin-open",
    "up": "triangle-up-open",
    "down": "triangle-down-open",
}


def area_fill(colour: str) -> Trace:
    """The fill of an area of this colour, which what lies behind it shines through."""
    return {"fillcolor": AREAS[colour]} if colour in AREAS else {"fillcolor": colour, "opacity": 0.15}


def traces_of(item: Item, panel: Panel, unified: bool) -> list[Trace]:
    """The traces of an item."""
    match item:
        case Line():
            return [_line(item, panel, unified)]
        case Band():
            return [_band(item)] if has_area(item.lower, item.upper) else []
        case Points():
            return [_points(item, panel)] if len(item.x) else []
        case Region():
            return [_region(item)]
        case Stems():
            return _stems(item)
        case Bars():
            return [_bars(item, panel)]
        case Histogram():
            return [_histogram(item)]
        case Ranges():
            return [_ranges(item, panel)]
        case _:
            raise TypeError(f"{type(item).__name__} is drawn as a shape")


def _legend_entry(label: str, key: bool = True) -> Trace:
    return {"name": label, "legendgroup": label, "showlegend": bool(label) and key}


def _line(item: Line, panel: Panel, unified: bool) -> Trace:
    """A line, each experiment for itself, thinned if it is long: the extremes of each interval stay, exactly."""
    t, y = np.asarray(item.x, dtype=float), np.asarray(item.y, dtype=float)
    lengths = list(item.lengths) or [len(t)]
    xs, ys, start = list[np.ndarray](), list[np.ndarray](), 0
    for n in lengths:
        x, v = style.thin(t[start : start + n], y[start : start + n], max(4, style.POINTS * n // len(t)))
        xs, ys = [*xs, x, x[-1:]], [*ys, v, np.full(1, np.nan)]
        start += n
    x, v = np.concatenate(xs)[:-1], np.concatenate(ys)[:-1]
    count = len(x) - len(lengths) + 1
    note = f"<br>thinned: {count:,} of {len(t):,} samples" if count < len(t) else ""
    hover = f"%{{y:.5g}} {panel.y.unit}".rstrip()
    if not unified and panel.x.name:
        hover = f"{panel.x.name} %{{x:.4g}} {panel.x.unit}<br>{panel.y.name} {hover}"
    trace = {
        "type": "scatter",
        "mode": "lines+markers" if item.dots and len(t) < DOTTED else "lines",
        "x": numbers(x),
        "y": numbers(v),
        "line": {"color": item.colour, "width": item.width, "shape": "hv" if item.steps else "linear"},
        "hovertemplate": f"{hover}{note}",
        **_legend_entry(item.label, item.key),
    }
    if trace["mode"] != "lines":
        trace["marker"] = {"size": 3}
    if item.dash:
        trace["line"]["dash"] = "dash"
    if item.dash or not item.label:  # a reference
        del trace["hovertemplate"]
        trace["hoverinfo"] = "skip"
    elif item.half is not None and np.isfinite(item.half).any() and count == len(t):
        trace["customdata"] = numbers(item.half)
        trace["hovertemplate"] += " ± %{customdata:.2g} (95 %)"
    return trace


def _band(item: Band) -> Trace:
    """The area between two curves, an outline of its own for each stretch in which both are known."""
    known = np.isfinite(item.lower) & np.isfinite(item.upper)
    outlines = list[tuple[np.ndarray, np.ndarray]]()
    for part in np.split(np.arange(len(known)), np.flatnonzero(np.diff(known)) + 1):
        if not known[part].all():
            continue
        x, low, high = (np.asarray(values, dtype=float)[part] for values in (item.x, item.lower, item.upper))
        if item.steps and len(x) > 1:  # the value stands from its sample to the next one
            x = np.concatenate([np.repeat(x, 2)[1:], [2 * x[-1] - x[-2]]])
            low, high = np.repeat(low, 2), np.repeat(high, 2)
        gap = [np.nan] if outlines else []
        outlines.append((np.concatenate([gap, x, x[::-1]]), np.concatenate([gap, low, high[::-1]])))
    xs, ys = zip(*outlines, strict=True) if outlines else ([np.zeros(0)], [np.zeros(0)])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(np.concatenate(xs)),
        "y": numbers(np.concatenate(ys)),
        "fill": "toself",
        **area_fill(item.colour),
        "line": {"width": 0, "color": item.colour},
        "hoverinfo": "skip",
        **_legend_entry(item.label, item.key),
    }


def _points(item: Points, panel: Panel) -> Trace:
    """Marks, with their texts or their values in the hover."""
    small = item.mark == "dot"
    line = {"width": 0 if small else 2, "color": item.colour}
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(item.x),
        "y": numbers(item.y),
        "marker": {"symbol": MARKS[item.mark], "size": 5 if small else 11, "color": item.colour, "line": line},
        "hovertemplate": f"%{{y:.5g}} {panel.y.unit}".rstrip(),
        **_legend_entry(item.label, item.key),
    }
    if item.texts:
        del trace["hovertemplate"]
        trace |= {"hovertext": list(item.texts), "hoverinfo": "text"}
    return trace


def _region(item: Region) -> Trace:
    """An ellipse, or a bar; hidden together with what it surrounds."""
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    z = item.x + 1j * item.y + np.exp(1j * item.tilt) * (item.a * np.cos(angle) + 1j * item.b * np.sin(angle))
    return {
        "type": "scatter",
        "mode": "lines",
        "x": z.real.tolist(),
        "y": z.imag.tolist(),
        "line": {"color": item.colour, "width": 1 if item.b else 5},
        "opacity": 0.45,
        "hoverinfo": "skip",
        **({"fill": "toself", "fillcolor": AREAS[style.MODEL]} if item.b else {}),
        **_legend_entry(item.label),
    }


def _stems(item: Stems) -> list[Trace]:
    """Bars, those that stand out last."""
    return [
        {
            "type": "bar",
            "x": item.x[group].tolist(),
            "y": numbers(item.y[group]),
            "marker": {"color": colour},
            "hovertemplate": f"lag %{{x}} samples<br>correlation %{{y:.3f}}<br>bound ±{item.bound:.3f}<extra></extra>",
            **_legend_entry(name),
        }
        for group, colour, name in (
            (~item.stand_out, style.INK, "by chance"),
            (item.stand_out, style.MODEL, "beyond chance"),
        )
    ]


def _bars(item: Bars, panel: Panel) -> Trace:
    """Horizontal bars."""
    rows = item.rows()
    marker = {"color": [colour for _, colour in rows]}
    texts = item.texts or item.notes
    hover: Trace = {"hovertext": list(texts), "hoverinfo": "text"} if texts else {}
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": numbers([length for length, _ in rows]),
        "y": list(panel.y.names),
        "marker": marker,
    }
    return bars | hover | ({"text": list(item.notes)} if item.notes else {}) | _legend_entry(item.label, item.key)


def _histogram(item: Histogram) -> Trace:
    edges = np.asarray(item.edges, dtype=float)
    ends = [f"{low:.5g} to {high:.5g}: {n}" for low, high, n in zip(edges, edges[1:], item.counts, strict=False)]
    bars = {"type": "bar", "x": numbers(0.5 * (edges[1:] + edges[:-1])), "y": numbers(item.counts)}
    look = {"width": numbers(np.diff(edges)), "marker": {"color": item.colour}, "hovertext": ends, "hoverinfo": "text"}
    return bars | look | _legend_entry("")


def _ranges(item: Ranges, panel: Panel) -> Trace:
    """Points with error bars, or open points, over places of names."""
    sure = item.low is not None and item.high is not None
    trace: Trace = {
        "type": "scatter",
        "mode": "markers",
        "x": list(item.x),
        "y": [panel.y.names[place] for place in item.places],
        "marker": {"color": item.colour, "size": 9, "symbol": "circle" if sure else "circle-open"},
        "hovertext": list(item.texts),
        "hoverinfo": "text",
        **_legend_entry(item.label),
    }
    if item.low is not None and item.high is not None:
        trace["error_x"] = {
            "type": "data",
            "symmetric": False,
            "thickness": 2,
            "width": 4,
            "color": item.colour,
            "array": [high - x for x, high in zip(item.x, item.high, strict=True)],
            "arrayminus": [x - low for x, low in zip(item.x, item.low, strict=True)],
        }
    return trace


def numbers(values: Any) -> list[float | None]:
    """Values (n,) as JSON numbers; None, a gap in a line, for what is not finite."""
    array = np.asarray(values, dtype=float)
    return [v if ok else None for v, ok in zip(array.tolist(), np.isfinite(array).tolist(), strict=True)]

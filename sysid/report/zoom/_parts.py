"""What all zoomable figures share: lines with no more points than can be seen, panels above each other, axes, hover.

A figure is a plain dictionary of plotly, {"data": [...], "layout": {...}}. The colours are those of the pictures
(`sysid.base.style`); the page replaces them in the dark.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base import style
from sysid.base.units import Quantity, shown
from sysid.data.record import IOData

Figure = dict[str, Any]
Trace = dict[str, Any]
GRID, FRAME = "#e4e7eb", "#9aa5b1"
PAPER = "rgba(0,0,0,0)"  # the page's own colour, light or dark
BAND = "rgba(194,65,12,0.22)"  # style.MODEL, transparent
BOUND = "rgba(47,111,143,0.16)"  # the area within which nothing is to be seen
COLOURS = (style.MODEL, style.INPUT, "#2f855a", "#805ad5", "#b7791f", "#d53f8c")  # of several models or channels
ROW = 165  # height of a panel [px]
TITLE = 20  # of a title [px]
DASHED = {"color": style.SECOND, "width": 1, "dash": "dash"}


@dataclass(frozen=True)
class Row:
    """A panel: label of its vertical axis, a title above it, and its height in panels."""

    label: str
    title: str = ""
    weight: float = 1.0


def numbers(values: np.ndarray) -> list[float | None]:
    """Values (n,) as JSON numbers; None, a gap in a line, for what is not finite."""
    array = np.asarray(values, dtype=float)
    return [v if ok else None for v, ok in zip(array.tolist(), np.isfinite(array).tolist(), strict=True)]


def times(values: np.ndarray, factor: float) -> np.ndarray:
    """Values in display units; what a diverging run makes too large for a number stays a gap."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(values, dtype=float) * factor


def columns(run: np.ndarray, N: int) -> np.ndarray:
    """A model's output as (N, ny), whether it came as (N,) or (N, ny)."""
    return np.asarray(run, dtype=float).reshape(N, -1)


def inputs(data: IOData) -> list[Quantity]:
    """Display of every input."""
    return _channels(data.u_name, data.u_unit, data.u.shape[1])


def outputs(data: IOData) -> list[Quantity]:
    """Display of every output."""
    return _channels(data.y_name, data.y_unit, data.y.shape[1])


def _channels(name: str | Sequence[str], unit: str | Sequence[str], n: int) -> list[Quantity]:
    """One quantity for each of n channels; a single name is numbered, a list in one string is taken apart."""
    names, units = (_each(text, n) for text in (name, unit))
    if n > 1 and len(set(names)) == 1:
        names = [f"{names[0]}{k + 1}" for k in range(n)]
    return [shown(*pair) for pair in zip(names, units, strict=True)]


def _each(text: str | Sequence[str], n: int) -> list[str]:
    parts = [part.strip() for part in text.split(",")] if isinstance(text, str) else list(text)
    return parts if len(parts) == n else [text if isinstance(text, str) else ", ".join(text)] * n


def line(
    t: np.ndarray,
    y: np.ndarray,
    name: str,
    colour: str,
    unit: str = "",
    row: int = 0,
    lengths: Sequence[int] = (),
    steps: bool = False,
    legend: bool = True,
    width: float = 1.5,
) -> Trace:
    """A line y (n,) over t (n,) in panel `row`, each experiment of `lengths` for itself, thinned if it is long.

    Of a thinned line the smallest and largest value of each interval stay, exactly; the hover says so. One click in the
    legend hides the lines of one name in all panels.
    """
    t, y = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    lengths = list(lengths) or [len(t)]
    xs, ys, start = list[np.ndarray](), list[np.ndarray](), 0
    for n in lengths:
        x, v = style.thin(t[start : start + n], y[start : start + n], max(4, style.POINTS * n // len(t)))
        gap = np.full(1, np.nan)
        xs, ys = [*xs, x, x[-1:]], [*ys, v, gap]
        start += n
    x, v = np.concatenate(xs)[:-1], np.concatenate(ys)[:-1]
    drawn = len(x) - len(lengths) + 1
    said = f"<br>thinned: {drawn:,} of {len(t):,} samples" if drawn < len(t) else ""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "y": numbers(v),
        "name": name,
        "legendgroup": name,
        "showlegend": legend,
        "line": {"color": colour, "width": width, "shape": "hv" if steps else "linear"},
        "hovertemplate": f"%{{y:.5g}} {unit}{said}".rstrip(),
        "xaxis": "x",
        "yaxis": axis(row),
    }


def thinned(traces: Sequence[Trace]) -> bool:
    """Whether one of the lines does not show every sample."""
    return any("thinned" in trace.get("hovertemplate", "") for trace in traces)


def axis(row: int) -> str:
    """The name of the vertical axis of a panel: y, y2, ..."""
    return "y" if row == 0 else f"y{row + 1}"


def band(x: np.ndarray, lower: np.ndarray, upper: np.ndarray, name: str, row: int = 0, steps: bool = False) -> Trace:
    """The area between two curves (n,) where both are finite."""
    known = np.isfinite(lower) & np.isfinite(upper)
    x, low, high = (np.asarray(values, dtype=float)[known] for values in (x, lower, upper))
    if steps and len(x) > 1:  # the value stands from its sample to the next one
        x = np.concatenate([np.repeat(x, 2)[1:], [2 * x[-1] - x[-2]]])
        low, high = np.repeat(low, 2), np.repeat(high, 2)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(np.concatenate([x, x[::-1]])),
        "y": numbers(np.concatenate([low, high[::-1]])),
        "fill": "toself",
        "fillcolor": BAND,
        "line": {"width": 0, "color": style.MODEL},
        "name": name,
        "hoverinfo": "skip",
        "xaxis": "x",
        "yaxis": axis(row),
    }


def stacked(traces: list[Trace], rows: Sequence[Row], x_label: str, notes: Sequence[str] = ()) -> Figure:
    """Panels above each other over one horizontal axis, so that a zoom in one is a zoom in all."""
    gap, total = 0.075 if any(row.title for row in rows) else 0.045, sum(row.weight for row in rows)
    free = 1.0 - gap * (len(rows) - 1)
    layout, top = base(x_label, height=round(ROW * total + 126)), 1.0
    for k, row in enumerate(rows):
        bottom = top - free * row.weight / total
        layout["yaxis" if k == 0 else f"yaxis{k + 1}"] = side(row.label) | {"domain": [max(bottom, 0.0), top]}
        if row.title:
            layout["annotations"].append(_text(f"<b>{row.title}</b>", 0.0, top, "left", "bottom"))
        top = bottom - gap
    if rows[0].title:  # which stands where a narrow legend begins
        over_titles(layout)
    layout["xaxis"]["anchor"] = axis(len(rows) - 1)
    layout |= {"hovermode": "x unified", "hoversubplots": "axis"}
    for note in notes:
        layout["annotations"].append(_text(note, 0.0, 0.0, "left", "bottom") | {"font": {"size": 11}})
    return {"data": traces, "layout": layout}


def over_titles(layout: Figure) -> None:
    """Move the legend over the titles of the first row, and make room for it."""
    layout["margin"]["t"] += TITLE
    layout["height"] += TITLE
    layout["legend"]["y"] = 1.0 + TITLE / (layout["height"] - layout["margin"]["t"] - layout["margin"]["b"])


def base(x_label: str, y_label: str | None = None, height: int = 360) -> Figure:
    """A layout without colours of its own, with labels that name units."""
    layout: Figure = {
        "xaxis": side(x_label),
        "height": height,
        "margin": {"l": 62, "r": 14, "t": 62, "b": 48},
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
    return layout if y_label is None else layout | {"yaxis": side(y_label)}


def side(label: str, **more: Any) -> Figure:
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


def upright(x: float, dash: str = "dot") -> Figure:
    """A vertical line over all panels, at the border of two parts or experiments."""
    look = {"color": style.SECOND, "width": 1, "dash": dash}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": look}


def borders(data: IOData, start: float = 0.0) -> list[Figure]:
    """Lines at the borders of the experiments of a record that begins at `start` [s]."""
    ends = np.cumsum(data.lengths)[:-1]
    return [upright(start + float(n - 0.5) * data.Ts) for n in ends]


def _text(text: str, x: float, y: float, xanchor: str, yanchor: str) -> Figure:
    place = {"xref": "paper", "yref": "paper", "x": x, "y": y, "xanchor": xanchor, "yanchor": yanchor}
    return {"text": text, "showarrow": False, "align": "left", **place}

"""Static maps with their bands, side by side in the order of the signal."""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.base import style
from sysid.base.units import shown
from sysid.plots._shade import has_area
from sysid.plots.static_maps import Words, words_of
from sysid.report.zoom import _parts as parts
from sysid.report.zoom._parts import DASHED, Figure, Trace
from sysid.uncertainty.curves import NORMALISED, Curve

GAP = 0.12


def static_maps(curves: Sequence[Curve], words: Mapping[str, Words] | None = None) -> Figure:
    """Every map of a chain; `words` are title, signal before and signal after the map, by role.

    On the normalised scale the dashed diagonal is a map that changes nothing.
    """
    n = len(curves)
    wide = (1.0 - GAP * (n - 1)) / n
    layout = parts.base("", height=330) | {"meta": {"beside": n}}
    parts.over_titles(layout)
    traces = list[Trace]()
    for k, curve in enumerate(curves):
        title, before, after = (words or {}).get(curve.role) or words_of(curve)
        x, y = shown(before, curve.x_unit), shown(after, curve.y_unit)
        start, suffix = k * (wide + GAP), "" if k == 0 else str(k + 1)
        layout[f"xaxis{suffix}"] = parts.side(x.label, domain=[start, start + wide], anchor=f"y{suffix}")
        layout[f"yaxis{suffix}"] = parts.side(y.label, anchor=f"x{suffix}")
        low, high = float(curve.band.value.min()) * y.factor, float(curve.band.value.max()) * y.factor
        if _wide(curve, y.factor, low, high):
            layout[f"yaxis{suffix}"]["range"] = [low - (high - low), high + (high - low)]  # a double click shows all
        layout["annotations"].append(
            {"text": f"<b>{title}</b>", "x": start, "y": 1, "xref": "paper", "yref": "paper"}
            | {"xanchor": "left", "yanchor": "bottom", "showarrow": False}
        )
        b = curve.band
        own = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}", "showlegend": False}
        at, value = b.x * x.factor, b.value * y.factor
        if has_area(b.lower, b.upper):
            area = parts.band(at, b.lower * y.factor, b.upper * y.factor, f"{100 * b.level:g} % band")
            traces.append(area | own | {"showlegend": k == 0})
        if curve.scale == NORMALISED:
            ends = [float(at[0]), float(at[-1])]
            diagonal = {"type": "scatter", "mode": "lines", "x": ends, "y": [v / x.factor * y.factor for v in ends]}
            traces.append(diagonal | own | {"line": DASHED, "name": "no nonlinearity", "hoverinfo": "skip"})
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": parts.numbers(at),
                "y": parts.numbers(value),
                "name": f"{curve.role} map",
                "line": {"color": style.MODEL, "width": 1.8},
                "customdata": parts.numbers(b.std * y.factor),
                "hovertemplate": f"{before} %{{x:.4g}} {x.unit}<br>{after} %{{y:.4g}} {y.unit}"
                + (f"<br>standard deviation %{{customdata:.2g}} {y.unit}" if np.isfinite(b.std).any() else "")
                + "<extra></extra>",
            }
            | own
        )
    return {"data": traces, "layout": layout}


def _wide(curve: Curve, factor: float, low: float, high: float) -> bool:
    """Whether the band is so wide that it would squeeze the curve."""
    b = curve.band
    edges = np.concatenate([b.lower, b.upper])[np.isfinite(np.concatenate([b.lower, b.upper]))] * factor
    return bool(high > low and len(edges) and (edges.min() < 2 * low - high or edges.max() > 2 * high - low))

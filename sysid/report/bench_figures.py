"""Figures of the benchmark: zoomable plots of the leaderboard, as dictionaries of plotly, and a bad cell drawn.

The plots of the leaderboard are made for plotly alone: a menu shows one family of scenarios at a time.
"""

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
import polars as pl

from sysid.base import style
from sysid.base.quantities import display_quantity
from sysid.bench.cell import Redrawn
from sysid.bench.leaderboard import CLAIMED, profile
from sysid.bench.table import BAR
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel
from sysid.drawing.plotly import LOG, Plotly, as_text, base_layout, side

ALL = "all families"
# Okabe and Ito's colours, which colour-blind readers can tell apart; methods of others are dashed too.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a8794", "#a05a2c")
TAUS = {"error": np.unique(np.round(np.geomspace(1.0, 30.0, 120), 4)), "time": np.geomspace(1.0, 1000.0, 120)}
SAMPLES = 600  # of a drawn cell, around the largest error: a long record would be a black band


def error_profile(rows: pl.DataFrame, ours: Collection[str]) -> Plotly:
    """Share of tasks on which the error of a method is within tau times the least error of any method."""
    return _profiles(rows, ours, lambda part: profile(part, TAUS["error"]), "error, in times of the best method's")


def time_profile(rows: pl.DataFrame, ours: Collection[str], within: float) -> Plotly:
    """The same for the seconds of a fit within `within` points of the bar."""
    title = f"time, in times of the fastest method that ends within {within:g} point of the bar"
    return _profiles(rows, ours, lambda part: profile(part, TAUS["time"], within), title)


def cost(board: pl.DataFrame, ours: Collection[str]) -> Plotly:
    """Mean gap against time, one mark a method; the gap is drawn from 0.001 point, so that zero has a place."""
    families = board["family"].unique(maintain_order=True).to_list()
    names = _names(board)
    traces, groups = list[Plotly](), list[str]()
    for family in families:
        for row in board.filter(pl.col("family") == family).iter_rows(named=True):
            if row["method"] == BAR or row["seconds"] is None:
                continue
            text = f"{as_text(row['method'])}: {row['lost']:.3f} points, {row['seconds']:.3g} s, {row['n']} tasks"
            look = _look(row["method"], names, ours)
            mark = {"size": 11, "color": look["color"], "symbol": "circle" if row["method"] in ours else "diamond-open"}
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers+text",
                    "x": [row["seconds"]],
                    "y": [max(row["lost"], 1e-3)],
                    "text": [as_text(row["method"])],
                    "textposition": "top center",
                    "hovertext": [text],
                    "hoverinfo": "text",
                    "name": as_text(row["method"]),
                    "marker": mark,
                }
            )
            groups.append(family)
    layout = _layout("time of a fit [s] (shifted geometric mean)", "mean gap to the bar [points of fit]", log=True)
    layout["yaxis"] |= LOG
    layout["showlegend"] = False
    return _by_family(traces, groups, families, layout)


def calibration(frame: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> Plotly:
    """Share of intervals that hold the truth by family and method, with Wilson's intervals and the claimed line."""
    names, traces = _names(board), list[Plotly]()
    for name in sorted(frame["method"].unique()):
        shown = as_text(name)
        own_rows = frame.filter((pl.col("method") == name) & (pl.col("intervals") > 0))
        rate, low, high = (100 * own_rows[f"held_{end}"].to_numpy() for end in ("rate", "low", "high"))
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [as_text(family) for family in own_rows["family"]],
                "y": _plain(rate),
                "error_y": {"array": _plain(high - rate), "arrayminus": _plain(rate - low), "thickness": 1.2},
                "name": shown,
                "marker": {"size": 9, "color": _look(name, names, ours)["color"]},
                "hovertext": [f"{shown}: {h} of {n} hold" for h, n in own_rows.select("held", "intervals").iter_rows()],
            }
        )
    layout = _layout("family", "intervals that hold the truth [%]")
    layout["xaxis"]["type"] = "category"
    layout["scattermode"] = "group"
    line = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 100 * CLAIMED, "y1": 100 * CLAIMED}
    look = {"color": style.SECOND, "dash": "dot", "width": 1.2}
    layout["shapes"] = [line | {"line": look, "name": f"{100 * CLAIMED:.0f} % claimed", "showlegend": True}]
    return {"data": traces, "layout": layout}


def cell_figure(cell: Redrawn) -> Figure:
    """Input, measured output with the free run over it, and the error, around the largest error."""
    error = np.where(np.isfinite(cell.run), cell.y - cell.run, np.nan)
    scored_errors = np.abs(error[cell.drop :])
    worst = int(np.nanargmax(scored_errors)) + cell.drop if np.isfinite(scored_errors).any() else 0
    start = max(0, min(worst - SAMPLES // 2, len(cell.y) - SAMPLES))
    window = slice(start, start + SAMPLES)
    t = np.arange(len(cell.y))[window] * cell.Ts
    error_lines: list[Item] = [Line(t, error[window], "measured less free run")]
    if cell.clean is not None:
        error_lines.append(Line(t, (cell.y - cell.clean)[window], "noise", style.SECOND))
    free_run = Line(t, cell.run[window], f"free run of {cell.method}")
    output_lines = [Line(t, cell.y[window], "measured", style.INK), free_run]
    low, high = float(np.nanmin(cell.y)), float(np.nanmax(cell.y))
    margin = 0.3 * (high - low) or 1.0  # a run that diverges must not flatten the measured output
    output_axis = Axis.of(display_quantity("output", cell.unit), (low - margin, high + margin))
    time_axis = Axis("time in the test [s]")
    panels = [
        Panel([Line(t, cell.u[window], "input", style.INPUT, key=False)], Axis("input"), time_axis, weight=0.8),
        Panel(output_lines, output_axis, time_axis, weight=1.8),
        Panel(error_lines, Axis.of(display_quantity("error", cell.unit)), time_axis),
    ]
    return Figure(panels, height=4.6)


def _profiles(
    rows: pl.DataFrame, ours: Collection[str], shares: Callable[[pl.DataFrame], pl.DataFrame], title: str
) -> Plotly:
    """Curves of the `shares` of tasks of each method, all families and each alone."""
    families, names = sorted(rows["family"].unique()), _names(rows)
    parts = {ALL: rows, **{family: rows.filter(pl.col("family") == family) for family in families}}
    traces, groups = list[Plotly](), list[str]()
    for family, part in parts.items():
        frame = shares(part)
        for k, name in enumerate(frame.columns[1:], 1):
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": _plain(frame["tau"].to_numpy()),
                    "y": _plain(100 * frame[name].to_numpy()),
                    "name": as_text(name),
                    # wide lines first, so that of lines that coincide the first ones show as rims
                    "line": {"shape": "hv", **_look(name, names, ours), "width": 2 + 2 * (len(frame.columns) - 1 - k)},
                }
            )
            groups.append(family)
    layout = _layout(title, "share of tasks [%]", log=True)
    layout["yaxis"]["range"] = [0, 101]
    return _by_family(traces, groups, list(parts), layout)


def _names(rows: pl.DataFrame) -> list[str]:
    return sorted(set(rows["method"].unique()) - {BAR})


def _look(name: str, names: Sequence[str], ours: Collection[str]) -> dict[str, Any]:
    """Colour and dash of a method, the same in every plot: ours in full lines, others dashed."""
    if name == BAR:
        return {"color": style.INK, "dash": "solid", "width": 2}
    side_names = [n for n in names if (n in ours) == (name in ours)]
    k = side_names.index(name)
    dashes = ("solid", "dashdot") if name in ours else ("dash", "dot")
    return {"color": COLOURS[k % len(COLOURS)], "dash": dashes[k // len(COLOURS) % 2], "width": 2}


def _by_family(traces: list[Plotly], groups: list[str], families: list[str], layout: Plotly) -> Plotly:
    """The figure with a menu that shows the traces of one family at a time, the first one first."""
    for trace, family in zip(traces, groups, strict=True):
        trace["visible"] = family == families[0]
    buttons = [
        {"label": as_text(family), "method": "restyle", "args": [{"visible": [family == group for group in groups]}]}
        for family in families
    ]
    menu = {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom", "direction": "down"}
    below = {"x": 0, "xanchor": "left", "y": 0, "yref": "container", "yanchor": "bottom"}  # not behind the menu
    legend = layout.get("legend", {}) | below
    return {"data": traces, "layout": layout | {"updatemenus": [menu], "legend": legend}}


def _layout(x: str, y: str, log: bool = False) -> Plotly:
    """Two axes with their labels, the horizontal one logarithmic if `log`."""
    scale = {"ticks": "outside", **(LOG if log else {})}
    return base_layout(470) | {"xaxis": side(x) | scale, "yaxis": side(y, ticks="outside")}


def _plain(values: np.ndarray) -> list[float]:
    return [float(f"{v:.5g}") for v in values]

"""Zoomable plots of the leaderboard, as plain plotly figures (dictionaries of data and layout)."""

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
import polars as pl

from sysid.base import style
from sysid.bench.columns import BAR
from sysid.bench.leaderboard import CLAIMED, profile
from sysid.report import embed

ALL = "all families"
# Okabe and Ito's colours, which colour-blind readers can tell apart; methods of others are dashed too.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a8794", "#a05a2c")
TAUS = {"error": np.unique(np.round(np.geomspace(1.0, 30.0, 120), 4)), "time": np.geomspace(1.0, 1000.0, 120)}
SCRIPT = "plotly.min.js"
Figure = dict[str, Any]


def error_profile(rows: pl.DataFrame, ours: Collection[str]) -> Figure:
    """Share of tasks on which the error of a method is within tau times the least error of any method."""
    return _profiles(rows, ours, lambda part: profile(part, TAUS["error"]), "error, in times of the best method's")


def time_profile(rows: pl.DataFrame, ours: Collection[str], within: float) -> Figure:
    """The same for the seconds of a fit within `within` points of the bar."""
    title = f"time, in times of the fastest method that ends within {within:g} point of the bar"
    return _profiles(rows, ours, lambda part: profile(part, TAUS["time"], within), title)


def cost(board: pl.DataFrame, ours: Collection[str]) -> Figure:
    """Mean gap against time, one mark a method; the gap is drawn from 0.001 point, so that zero has a place."""
    families = board["family"].unique(maintain_order=True).to_list()
    names = _names(board)
    traces, shown = list[Any](), list[str]()
    for family in families:
        for row in board.filter(pl.col("family") == family).iter_rows(named=True):
            if row["method"] == BAR or row["seconds"] is None:
                continue
            text = f"{row['method']}: {row['lost']:.3f} points, {row['seconds']:.3g} s, {row['n']} tasks"
            look = _look(row["method"], names, ours)
            mark = {"size": 11, "color": look["color"], "symbol": "circle" if row["method"] in ours else "diamond-open"}
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers+text",
                    "x": [row["seconds"]],
                    "y": [max(row["lost"], 1e-3)],
                    "text": [row["method"]],
                    "textposition": "top center",
                    "hovertext": [text],
                    "hoverinfo": "text",
                    "name": row["method"],
                    "marker": mark,
                }
            )
            shown.append(family)
    layout = _layout("time of a fit [s] (shifted geometric mean)", "mean gap to the bar [points of fit]", log=True)
    layout["yaxis"]["type"] = "log"
    layout["showlegend"] = False
    return _by_family(traces, shown, families, layout)


def calibration(frame: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> Figure:
    """Share of intervals that hold the truth by family and method, with Wilson's intervals and the claimed line."""
    names, traces = _names(board), list[Any]()
    for name in sorted(frame["method"].unique()):
        mine = frame.filter((pl.col("method") == name) & (pl.col("intervals") > 0))
        rate, low, high = (100 * mine[f"held_{end}"].to_numpy() for end in ("rate", "low", "high"))
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": mine["family"].to_list(),
                "y": _plain(rate),
                "error_y": {"array": _plain(high - rate), "arrayminus": _plain(rate - low), "thickness": 1.2},
                "name": name,
                "marker": {"size": 9, "color": _look(name, names, ours)["color"]},
                "hovertext": [f"{name}: {h} of {n} hold" for h, n in mine.select("held", "intervals").iter_rows()],
            }
        )
    layout = _layout("family", "intervals that hold the truth [%]")
    layout["xaxis"]["type"] = "category"
    layout["scattermode"] = "group"
    line = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 100 * CLAIMED, "y1": 100 * CLAIMED}
    layout["shapes"] = [line | {"line": {"color": style.SECOND, "dash": "dot", "width": 1.2}}]
    return {"data": traces, "layout": layout}


def html(figure: Figure, name: str) -> str:
    """The element of a page that shows the figure; the page loads `SCRIPT`."""
    return embed.element(figure, name)


def script() -> str:
    """The text of `SCRIPT`."""
    return embed.script()


def _profiles(
    rows: pl.DataFrame, ours: Collection[str], shares: Callable[[pl.DataFrame], pl.DataFrame], title: str
) -> Figure:
    families, names = sorted(rows["family"].unique()), _names(rows)
    parts = {ALL: rows, **{family: rows.filter(pl.col("family") == family) for family in families}}
    traces, shown = list[Any](), list[str]()
    for family, part in parts.items():
        frame = shares(part)
        for name in frame.columns[1:]:
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": _plain(frame["tau"].to_numpy()),
                    "y": _plain(100 * frame[name].to_numpy()),
                    "name": name,
                    "line": {"shape": "hv", **_look(name, names, ours)},
                }
            )
            shown.append(family)
    layout = _layout(title, "share of tasks [%]", log=True)
    layout["yaxis"]["range"] = [0, 101]
    return _by_family(traces, shown, list(parts), layout)


def _names(rows: pl.DataFrame) -> list[str]:
    return sorted(set(rows["method"].unique()) - {BAR})


def _look(name: str, names: Sequence[str], ours: Collection[str]) -> dict[str, Any]:
    """Colour and dash of a method, the same in every plot: ours in full lines, others dashed."""
    if name == BAR:
        return {"color": style.INK, "dash": "solid", "width": 2}
    mine = [n for n in names if (n in ours) == (name in ours)]
    k = mine.index(name)
    dashes = ("solid", "dashdot") if name in ours else ("dash", "dot")
    return {"color": COLOURS[k % len(COLOURS)], "dash": dashes[k // len(COLOURS) % 2], "width": 2}


def _by_family(traces: list[Any], shown: list[str], families: list[str], layout: Figure) -> Figure:
    """The figure with a menu that shows the traces of one family at a time, the first one first."""
    for trace, family in zip(traces, shown, strict=True):
        trace["visible"] = family == families[0]
    buttons = [
        {"label": family, "method": "restyle", "args": [{"visible": [family == each for each in shown]}]}
        for family in families
    ]
    menu = {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom", "direction": "down"}
    return {"data": traces, "layout": layout | {"updatemenus": [menu]}}


def _layout(x: str, y: str, log: bool = False) -> Figure:
    axis = {"gridcolor": "#e4e7eb", "zeroline": False, "linecolor": "#9aa5b1", "ticks": "outside"}
    return {
        "xaxis": axis | {"title": {"text": x}, "type": "log" if log else "-", "dtick": "D2" if log else None},
        "yaxis": axis | {"title": {"text": y}},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "height": 470,
        "margin": {"l": 70, "r": 20, "t": 60, "b": 60},
        "font": {"color": style.INK, "size": 13},
        "hovermode": "closest",
    }


def _plain(values: np.ndarray) -> list[float]:
    return [float(f"{v:.5g}") for v in values]

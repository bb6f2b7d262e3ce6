"""Figures of the page as plain dictionaries of plotly: those of the reports, and the few that only the page has."""

from base64 import b64encode
from collections.abc import Mapping
from copy import deepcopy
from html import escape
from typing import Any

import numpy as np

from sysid.base import style
from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, percent
from sysid.data.record import IOData
from sysid.report import zoom
from sysid.report.figures import TABLE
from sysid.workflow.results import Evaluation
from twin.app.entries import Runs

Figure = dict[str, Any]
COLOURS = (style.MODEL, style.INPUT, "#2f855a", "#805ad5", "#b7791f", "#d53f8c")
TITLES = {  # of the tabs, in their order; names of `sysid.report.figures.TABLE`
    "free-run": "Free run",
    "residuals": "Residuals",
    "static-maps": "Static maps",
    "pole-zero": "Poles",
    "bode": "Bode",
    "step-response": "Step",
    "values": "Physical values",
    "growth": "Parts",
}


def of_model(e: Evaluation, start: float = 0.0) -> tuple[dict[str, Figure], list[str]]:
    """Every zoomable figure of the report that this model has, with its caption, and why a figure is missing.

    Free runs are on the record's own levels, over the time of the log, in which the fitted range begins at `start` [s].
    """
    drawings, complaints = dict[str, Figure](), list[str]()
    for name, title in TITLES.items():
        kind = TABLE[name]
        if kind.zoom is None or not kind.applies(e):
            continue
        try:
            figure = kind.zoom(e)
            figure = _shift_time(figure, start) if name == "free-run" else figure
            drawings[name] = {"figure": figure, "caption": kind.caption(e)}
        except (InputError, np.linalg.LinAlgError) as error:
            complaints.append(f"no figure '{title}': {error}")
    return drawings, complaints


def _shift_time(figure: Figure, start: float) -> Figure:
    """A figure over time, all of it `start` [s] later."""
    for trace in figure["data"]:
        trace["x"] = [None if x is None else x + start for x in trace["x"]]
    for item in (*figure["layout"]["shapes"], *figure["layout"]["annotations"]):
        if item.get("xref") == "x":
            item |= {name: item[name] + start for name in ("x", "x0", "x1") if name in item}
    return figure


def of_record(data: IOData, start: float | None, stop: float | None, height: int = 360) -> Figure:
    """Inputs and outputs over time, with what lies outside of the range in grey; a drag chooses a range."""
    figure = zoom.record(data)
    layout = figure["layout"]
    last = (data.N - 1) * data.Ts
    low, high = start or 0.0, last if stop is None else min(stop, last)
    grey = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "line": {"width": 0}}
    for a, b in ((0.0, low), (high, last)):
        if b > a:
            layout["shapes"].append(grey | {"x0": a, "x1": b, "fillcolor": "rgba(122,135,148,0.28)"})
    layout |= {"dragmode": "select", "selectdirection": "h", "height": height, "uirevision": f"{data.N}"}
    for trace in figure["data"]:
        trace["mode"] = "lines+markers"  # plotly selects points, not lines
        trace["marker"] = {"size": 1, "opacity": 0.01}
        trace["name"] = escape(str(trace["name"]))
    return ready(figure)


def overlay(models: Mapping[str, Runs]) -> Figure:
    """Measured output and free runs of several models, by name, over the time of the log."""
    traces, layout = list[Figure](), _layout("time [s]", 380)
    for k, (name, runs) in enumerate(models.items()):
        quantity = display_quantity(runs.name, runs.unit)
        layout["yaxis"]["title"] = {"text": escape(quantity.label), "standoff": 8}
        if k == 0:
            traces.append(_line(runs.t, runs.y * quantity.factor, "measured", style.INK, 1.8, quantity.unit))
            low, high = np.nanmin(runs.y), np.nanmax(runs.y)
            half = 0.75 * (high - low)  # a run that leaves the data does not squeeze the others
            if any(np.abs(model_runs.run - 0.5 * (low + high)).max() > 2 * half for model_runs in models.values()):
                middle = 0.5 * (low + high)
                layout["yaxis"]["range"] = [(middle - half) * quantity.factor, (middle + half) * quantity.factor]
        with np.errstate(over="ignore"):
            values = runs.run * quantity.factor
        traces.append(_line(runs.t, values, escape(name), COLOURS[k % len(COLOURS)], 1.2, quantity.unit))
        layout["shapes"].append(
            {"type": "line", "x0": runs.border, "x1": runs.border, "yref": "paper", "y0": 0, "y1": 1}
            | {"line": {"color": style.SECOND, "width": 1, "dash": "dot"}}
        )
    return ready({"data": traces, "layout": layout})


def of_comparison(result: Any) -> dict[str, Figure]:
    """A log beside the twin: both angles, and the error below."""
    degrees = 180.0 / np.pi
    layout = _layout("time [s]", 420)
    layout["yaxis"] |= {"title": {"text": "angle [deg]"}, "domain": [0.42, 1]}
    layout["yaxis2"] = _axis("error [deg]") | {"domain": [0, 0.32]}
    layout["xaxis"]["anchor"] = "y2"
    traces = [
        _line(result.t, result.y * degrees, "log", style.INK, 1.8, "deg"),
        _line(result.t, result.other * degrees, "twin", style.MODEL, 1.2, "deg"),
        _line(result.t, result.error * degrees, "log less twin", style.SECOND, 1.0, "deg") | {"yaxis": "y2"},
    ]
    caption = "Where the two angles part, the twin lacks something or has other values; the sentences above say what."
    return {"run": {"figure": {"data": traces, "layout": layout}, "caption": caption}}


def of_calibration(result: Any) -> dict[str, Figure]:
    """The first log with the twin before and after."""
    run, degrees = result.runs[0], 180.0 / np.pi
    layout = _layout("time [s]", 380)
    layout["yaxis"]["title"] = {"text": "angle [deg]"}
    t = np.arange(len(run.y)) * run.Ts
    traces = [
        _line(t, run.y * degrees, "log", style.INK, 1.8, "deg"),
        _line(t, run.before * degrees, "twin before", style.SECOND, 1.0, "deg"),
        _line(t, run.after * degrees, "twin calibrated", style.MODEL, 1.2, "deg"),
    ]
    caption = "The calibrated twin lies on the log; the grey line is the twin with the parameters that it had before."
    return {"run": {"figure": {"data": traces, "layout": layout}, "caption": caption}}


MODEBAR = {"bgcolor": "rgba(0,0,0,0)", "color": "#9aa5b1", "activecolor": style.INPUT}
PACKED = 64  # numbers
CONFIG = {"displaylogo": False, "responsive": True, "scrollZoom": False, "modeBarButtonsToRemove": ["lasso2d"]}


def ready(figure: Figure) -> Figure:
    """A stored figure with the page's buttons."""
    layout = {**figure["layout"], "modebar": MODEBAR}
    return {"data": [_pack(trace) for trace in figure["data"]], "layout": layout, "config": CONFIG}


def _pack(trace: Figure) -> Figure:
    """A trace with its long lists of numbers as the bytes of their doubles: one text, not thousands of values."""
    packed_trace = dict(trace)
    for axis in ("x", "y"):
        values = trace.get(axis)
        if isinstance(values, list) and len(values) > PACKED and all(isinstance(v, int | float | None) for v in values):
            doubles = np.array([np.nan if v is None else v for v in values], dtype="<f8")
            packed_trace[axis] = {"dtype": "f8", "bdata": b64encode(doubles.tobytes()).decode("ascii")}
    return packed_trace


def stack_panels(figure: Figure) -> Figure | None:
    """A figure with its panels below instead of beside each other, for a narrow window; None if it has one panel."""
    n = figure["layout"].get("meta", {}).get("beside", 1)
    if n < 2:
        return None
    layout = deepcopy(figure["layout"])
    space, height = 0.35, layout["height"]
    panel = 1.0 / (n + space * (n - 1))
    for k in range(n):
        suffix, top = "" if k == 0 else str(k + 1), 1.0 - k * (1.0 + space) * panel
        layout[f"xaxis{suffix}"]["domain"] = [0.0, 1.0]
        layout[f"yaxis{suffix}"]["domain"] = [max(top - panel, 0.0), top]
        layout["annotations"][k] |= {"x": 0.0, "y": top}
    layout["height"] = round(0.8 * n * height)
    layout["legend"]["y"] = 1.0 + (layout["legend"]["y"] - 1.0) * height / layout["height"]
    return {"data": figure["data"], "layout": layout}


def remark(figure: Figure) -> str:
    """What the figure's maker wants said beside it; empty if nothing."""
    return str(figure.get("layout", {}).get("meta", {}).get("said", ""))


def name_of(name: str, fit: float | None) -> str:
    """A model in a legend."""
    return f"{name}: {percent(fit) if fit is not None else 'no finite fit'}"


def _line(t: np.ndarray, y: np.ndarray, name: str, colour: str, width: float, unit: str) -> Figure:
    x, v = style.thin(np.asarray(t, dtype=float), np.asarray(y, dtype=float))
    values = [float(value) if np.isfinite(value) else None for value in v]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x.tolist(),
        "y": values,
        "name": name,
        "line": {"color": colour, "width": width},
        "hovertemplate": f"%{{y:.4g}} {escape(unit)}",
    }


def _layout(x_label: str, height: int) -> Figure:
    return {
        "xaxis": _axis(x_label),
        "yaxis": _axis(""),
        "height": height,
        "margin": {"l": 56, "r": 12, "t": 40, "b": 44},
        "font": {"color": style.INK, "size": 12, "family": "system-ui, Segoe UI, DejaVu Sans, sans-serif"},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "hovermode": "x unified",
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "shapes": [],
    }


def _axis(label: str) -> Figure:
    return {
        "title": {"text": label, "standoff": 8},
        "gridcolor": "#e4e7eb",
        "linecolor": "#9aa5b1",
        "zeroline": False,
        "automargin": True,
    }

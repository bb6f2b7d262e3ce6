"""Figures of the page as plain dictionaries of plotly: those of the reports, and the few that only the page has."""

from collections.abc import Callable, Mapping
from html import escape
from typing import Any

import numpy as np

from sysid.base import style
from sysid.base.errors import InputError
from sysid.base.units import percent, shown
from sysid.data.record import IOData
from sysid.workflow.evaluation import Evaluation
from twin.app.records import Runs

Figure = dict[str, Any]
COLOURS = (style.MODEL, style.INPUT, "#2f855a", "#805ad5", "#b7791f", "#d53f8c")
TITLES = {  # of the tabs, in their order
    "run": "Free run",
    "residuals": "Residual tests",
    "maps": "Static maps",
    "poles": "Poles and zeros",
    "bode": "Bode",
    "step": "Step response",
    "values": "Physical values",
}
SEE = {
    "run": "A good model's free run lies on the measured output in the validation part too; what is left is the error.",
    "residuals": "Bars inside the area are chance: then the residuals are white and independent of the input.",
    "maps": "Each static map with its 95 % band over the range that the record shows; wide bands are guesses.",
    "poles": "Crosses are poles, rings zeros, ellipses their 95 % regions; poles inside the circle are stable.",
    "bode": "The frequency response of the tangent linear model with its 95 % band.",
    "step": "The tangent's answer to a unit step of the input; its final value is the gain.",
    "values": "Physical values of the joint; a bar is the 95 % interval, an open point is not determined.",
}


def of_model(e: Evaluation) -> tuple[dict[str, Figure], list[str]]:
    """Every figure that this model has, by the names in `TITLES`, and why a figure is missing."""
    from sysid.report import zoom
    from sysid.uncertainty.information import information

    drawn, complaints = {"run": zoom.free_run(e)}, list[str]()
    wanted: dict[str, Callable[[], Figure]] = {}
    if e.tests is not None:
        wanted["residuals"] = lambda: zoom.residual_tests(e.tests)
    if e.linear:
        wanted["poles"] = lambda: zoom.poles_zeros(e.roots or e.poles, e.zeros, e.estimation.Ts)
    info = None
    if e.maps or e.linear:
        try:
            coloured = e.tests is not None and not e.tests.white
            info = information(e.fit, e.estimation, lags="auto" if coloured else None)  # type: ignore[arg-type]
        except (InputError, np.linalg.LinAlgError) as error:
            complaints.append(f"no bands: {error}")
    if e.maps:
        wanted["maps"] = lambda: _maps(e, info)
    if e.linear and info is not None:
        wanted["bode"] = lambda: _bode(e, info)
        wanted["step"] = lambda: _step(e, info)
    if e.values:
        wanted["values"] = lambda: zoom.values(e.values)
    for name, draw in wanted.items():
        try:
            drawn[name] = draw()
        except (InputError, np.linalg.LinAlgError) as error:
            complaints.append(f"no figure '{TITLES[name]}': {error}")
    return drawn, complaints


def _maps(e: Evaluation, info: Any) -> Figure:
    """The maps with bands, or bare where the record gives none."""
    from sysid.report import zoom
    from sysid.report.figures.static_maps import WORDS, curve_of
    from sysid.uncertainty.curves import curves

    try:
        found = list(curves(info)) if info is not None else []
    except (InputError, np.linalg.LinAlgError):
        found = []
    return zoom.static_maps(found or [curve_of(e, role) for role in e.maps], WORDS)


def _bode(e: Evaluation, info: Any) -> Figure:
    from sysid.report import zoom
    from sysid.uncertainty.responses import frequency

    return zoom.bode(frequency(info, float(np.mean(e.estimation.u))), e.estimation.y_unit, e.estimation.u_unit)


def _step(e: Evaluation, info: Any) -> Figure:
    from sysid.report import zoom
    from sysid.uncertainty.responses import step

    data = e.estimation
    return zoom.step(step(info, float(np.mean(data.u))), data.y_unit, data.u_unit, data.y_name)


def of_record(data: IOData, start: float | None, stop: float | None, height: int = 360) -> Figure:
    """Inputs and outputs over time, with what lies outside of the range in grey; a drag chooses a range."""
    from sysid.report import zoom

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
    return _plain(figure)


def overlay(models: Mapping[str, Runs]) -> Figure:
    """Measured output and free runs of several models, by name, over the time of the log."""
    traces, layout = list[Figure](), _layout("time [s]", 380)
    for k, (name, runs) in enumerate(models.items()):
        quantity = shown(runs.name, runs.unit)
        layout["yaxis"]["title"] = {"text": escape(quantity.label), "standoff": 8}
        if k == 0:
            traces.append(_line(runs.t, runs.y * quantity.factor, "measured", style.INK, 1.8, quantity.unit))
            low, high = np.nanmin(runs.y), np.nanmax(runs.y)
            half = 0.75 * (high - low)  # a run that leaves the data does not squeeze the others
            if any(np.abs(each.run - 0.5 * (low + high)).max() > 2 * half for each in models.values()):
                middle = 0.5 * (low + high)
                layout["yaxis"]["range"] = [(middle - half) * quantity.factor, (middle + half) * quantity.factor]
        with np.errstate(over="ignore"):
            values = runs.run * quantity.factor
        traces.append(_line(runs.t, values, escape(name), COLOURS[k % len(COLOURS)], 1.2, quantity.unit))
        layout["shapes"].append(
            {"type": "line", "x0": runs.border, "x1": runs.border, "yref": "paper", "y0": 0, "y1": 1}
            | {"line": {"color": style.SECOND, "width": 1, "dash": "dot"}}
        )
    return {"data": traces, "layout": layout, "config": CONFIG}


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
    return {"run": {"data": traces, "layout": layout, "config": CONFIG}}


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
    return {"run": {"data": traces, "layout": layout, "config": CONFIG}}


CONFIG = {"displaylogo": False, "responsive": True, "scrollZoom": False, "modeBarButtonsToRemove": ["lasso2d"]}


def ready(figure: Figure) -> Figure:
    """A stored figure with the page's buttons."""
    return {**figure, "config": CONFIG}


def said(figure: Figure) -> str:
    """What the figure's maker wants said beside it; empty if nothing."""
    return str(figure.get("layout", {}).get("meta", {}).get("said", ""))


def name_of(name: str, fit: float | None) -> str:
    """A model in a legend."""
    return f"{name}: {percent(fit) if fit is not None else 'no finite fit'}"


def _plain(figure: Figure) -> Figure:
    return {"data": figure["data"], "layout": figure["layout"], "config": CONFIG}


def _line(t: np.ndarray, y: np.ndarray, name: str, colour: str, width: float, unit: str) -> Figure:
    x, v = style.thin(np.asarray(t, dtype=float), np.asarray(y, dtype=float))
    values = [float(each) if np.isfinite(each) else None for each in v]
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

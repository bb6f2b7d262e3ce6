"""Figures of the page for plotly: those of the reports, and the few that only the page has."""

import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, percent
from sysid.data.record import IOData
from sysid.drawing.figure import Axis, Figure, Line, Panel, Rule, Span, scaled
from sysid.drawing.plotly import Plotly, plotly
from sysid.plots.records import record_figure
from sysid.report import page
from sysid.report.figures import TABLE
from sysid.workflow.results import Evaluation, single_channels
from twin.app.entries import Model
from twin.app.samples import Runs

if TYPE_CHECKING:
    from sysid.workflow.input_run import InputRun
    from sysid.workflow.model_run import ModelRun
    from twin.calibrate.result import Calibration
    from twin.compare.comparison import Comparison


def of_model(e: Evaluation, start: float = 0.0) -> tuple[dict[str, Plotly], list[str]]:
    """Every figure of the report that has a tab and fits this model, with its caption, and why one is missing.

    Free runs are on the record's own levels, over the time of the log, in which the fitted range begins at `start` [s].
    """
    drawings, complaints = dict[str, Plotly](), list[str]()
    for name, kind in TABLE.items():
        for mark, lead, channel in single_channels(e, kind.section) if kind.tab else ():
            if not kind.applies(channel):
                continue
            try:
                figure = kind.zoom(channel)
                figure = _shift_time(figure, start) if name == "free-run" else figure
                drawings[name + mark] = {"figure": figure, "caption": f"{lead}{kind.caption(channel)}"}
            except (InputError, np.linalg.LinAlgError) as error:
                complaints.append(f"no figure '{kind.tab}': {error}")
    return drawings, complaints


def tab_of(name: str) -> str:
    """The title of a figure's tab, with the number of one of several outputs; studies' figures stand in no table."""
    known = next((kind for kind in TABLE if name.startswith(kind) and re.fullmatch(r"(-\d+)?", name[len(kind) :])), "")
    return f"{TABLE[known].tab} {name[len(known) + 1 :]}".rstrip() if known else name.capitalize()


def _shift_time(figure: Plotly, start: float) -> Plotly:
    """A figure over time, all of it `start` [s] later."""
    for trace in figure["data"]:
        trace["x"] = [None if x is None else x + start for x in trace["x"]]
    for item in (*figure["layout"]["shapes"], *figure["layout"]["annotations"]):
        if item.get("xref") == "x":
            item |= {name: item[name] + start for name in ("x", "x0", "x1") if name in item}
    return figure


def of_record(data: IOData, start: float | None, stop: float | None, height: int = 360) -> Plotly:
    """Inputs and outputs over time, with what lies outside of the range in grey; a drag chooses a range."""
    last = (data.N - 1) * data.Ts
    low, high = start or 0.0, last if stop is None else min(stop, last)
    grey = [Span(a, b, colour=style.SECOND) for a, b in ((0.0, low), (high, last)) if b > a]
    description = record_figure(data)
    figure = plotly(replace(description, marks=[*description.marks, *grey]))
    figure["layout"] |= {"dragmode": "select", "selectdirection": "h", "height": height, "uirevision": f"{data.N}"}
    for trace in figure["data"]:
        trace["mode"] = "lines+markers"  # plotly selects points, not lines
        trace["marker"] = {"size": 1, "opacity": 0.01}
    return ready(figure)


def overlay(models: Mapping[str, Runs]) -> Plotly:
    """Measured output and free runs of several models, by name, over the time of the log; each validation begins at a
    dotted line."""
    runs = list(models.values())
    panels = [_overlay_panel(models, j) for j in range(len(runs[0].outputs))]
    borders = [Rule(border, dash="dot") for border in dict.fromkeys(model_runs.border for model_runs in runs)]
    return ready(plotly(Figure(panels, marks=borders)))


def _overlay_panel(models: Mapping[str, Runs], j: int) -> Panel:
    """The panel of output j; the lines of models have their names in the first one."""
    first = next(iter(models.values()))
    q, y = display_quantity(*first.outputs[j]), first.y[:, j]
    low, high = np.nanmin(y), np.nanmax(y)
    middle, half = 0.5 * (low + high), 0.75 * (high - low)  # a run that leaves the data does not squeeze the others
    departs = any(np.abs(model_runs.run[:, j] - middle).max() > 2 * half for model_runs in models.values())
    near_data = ((middle - half) * q.factor, (middle + half) * q.factor) if departs else None
    lines = [Line(first.t, scaled(y, q.factor), "measured", style.INK, 1.8, key=j == 0)]
    for (name, model_runs), colour in zip(models.items(), cycle(style.COLOURS), strict=False):
        lines.append(Line(model_runs.t, scaled(model_runs.run[:, j], q.factor), name, colour, 1.2, key=j == 0))
    return Panel(lines, Axis.of(q, near=near_data), Axis.time(), weight=1.6)


def of_run(result: "ModelRun | InputRun") -> dict[str, Plotly]:
    """A saved model on a record, and its prediction some samples ahead, as in the report."""
    from sysid.report import saved_models_parts as parts
    from sysid.workflow.input_run import InputRun

    if isinstance(result, InputRun):
        caption = "The input, and the model's run from rest."
        return {"run": {"figure": plotly(parts.input_run_figure(result)), "caption": caption}}
    caption = "Measured and free run; below, what is left: a good model leaves what looks like noise."
    drawings = {"run": {"figure": plotly(parts.run_figure(result)), "caption": caption}}
    if result.ahead is not None:
        k = result.ahead.horizon
        caption = (
            f"No free run: each output is predicted from the measured ones up to {k} sample(s) before it. Compare its "
            "fit with that of the last measured output held."
        )
        drawings["prediction"] = {"figure": plotly(parts.prediction_figure(result)), "caption": caption}
    return drawings


def of_comparison(result: "Comparison") -> dict[str, Plotly]:
    """A log beside the twin, as in the report."""
    from twin.report.compare_figures import overlay_figure

    caption = "Where the two angles part, the twin lacks something or has other values; the sentences above say what."
    return {"run": {"figure": plotly(overlay_figure(result)), "caption": caption}}


def of_calibration(result: "Calibration") -> dict[str, Plotly]:
    """The first log with the twin before and after, as in the report."""
    from twin.report.calibrate import overlay_figure

    caption = "The calibrated twin lies on the log; the grey line is the twin with the parameters that it had before."
    return {"run": {"figure": plotly(overlay_figure(result.runs[0])), "caption": caption}}


MODEBAR = {"bgcolor": "rgba(0,0,0,0)", "color": "#9aa5b1", "activecolor": style.INPUT}
CONFIG = {"displaylogo": False, "responsive": True, "scrollZoom": False, "modeBarButtonsToRemove": ["lasso2d"]}


def ready(figure: Plotly) -> Plotly:
    """A stored figure with the page's buttons; its long lists of numbers are texts, not thousands of values."""
    return page.packed({**figure, "layout": {**figure["layout"], "modebar": MODEBAR}, "config": CONFIG})


def stack_panels(figure: Plotly) -> Plotly | None:
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


def remark(figure: Plotly) -> str:
    """What the figure's maker wants said beside it; empty if nothing."""
    return str(figure.get("layout", {}).get("meta", {}).get("said", ""))


def name_of(key: str, model: Model) -> str:
    """A model in a legend, with its fit to unseen data, or to the record where all of it was fitted."""
    fit = model.fit_estimation if model.whole else model.fit_validation
    return f"{key}: {percent(fit) if fit is not None else 'no finite fit'}{' of the record' if model.whole else ''}"

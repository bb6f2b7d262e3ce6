"""Measured outputs and free runs over time, each output in a panel, with the errors and the inputs below.

No limit cuts off a run. Where one leaves the data far, the figure opens on the data, a sentence says how far the run
goes, and a button (or a double click) shows it whole.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.base import style
from sysid.base.units import Quantity, percent
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.plots._departure import departure, frame
from sysid.report.zoom import _parts as parts
from sysid.report.zoom._parts import COLOURS, Figure, Row, Trace
from sysid.report.zoom.records import TIME
from sysid.workflow.results import Evaluation

MEASURED = "measured"


def free_run(evaluation: Evaluation) -> Figure:
    """The free run of the model over estimation and validation data, which follow each other in time.

    A click on "model" in the legend hides it in all panels; the border of the two parts is a full line.
    """
    e = evaluation
    return _over_both(e, e.estimation_output, e.validation_output, "free run", COLOURS[0], e.validation_fit)


def one_step(evaluation: Evaluation) -> Figure:
    """The one-step-ahead prediction of a nonlinear ARX model, which uses all earlier measured outputs."""
    e, one = evaluation, evaluation.one_step
    assert one is not None
    words = "one step ahead, NOT a free run"
    return _over_both(e, one.estimation_output, one.validation_output, words, style.INPUT, one.validation_fit)


def runs(data: IOData, models: Mapping[str, np.ndarray], measured: str = MEASURED) -> Figure:
    """The outputs (N,) or (N, ny) of several models over one record, by name; each can be hidden in the legend.

    `measured` is the name of the record in the legend.
    """
    shown = {name: parts.columns(run, data.N) + data.y_offset for name, run in models.items()}
    return _figure(retrend(data), shown, dict(zip(shown, COLOURS * len(shown), strict=False)), measured)


def _over_both(
    e: Evaluation, estimation: np.ndarray, validation: np.ndarray, what: str, colour: str, fit: float
) -> Figure:
    both = joined(e.estimation, e.validation)
    pairs = ((e.estimation, estimation), (e.validation, validation))
    run = np.concatenate([parts.columns(output, data.N) + data.y_offset for data, output in pairs])
    name = f"{what}, fit {percent(fit)} in validation"
    figure = _figure(both, {name: run}, {name: colour})
    cut = (e.estimation.N - 0.5) * both.Ts
    # The borders of experiments are dotted, that of the two parts is not.
    figure["layout"]["shapes"] = [s for s in figure["layout"]["shapes"] if s.get("x0") != cut]
    figure["layout"]["shapes"].append(parts.upright(cut, "solid"))
    for x, anchor, words in ((cut, "right", "estimation "), (cut, "left", " validation")):
        text = {"text": words, "x": x, "xref": "x", "y": 1, "yref": "paper", "xanchor": anchor, "yanchor": "top"}
        figure["layout"]["annotations"].append({**text, "showarrow": False, "font": {"size": 11}})
    return figure


def joined(estimation: IOData, validation: IOData) -> IOData:
    """Both parts as one record of several experiments, as recorded: constants that were removed are added again."""
    return IOData.merge(retrend(estimation), retrend(validation))


def _figure(
    data: IOData, models: Mapping[str, np.ndarray], colours: Mapping[str, str], named: str = MEASURED
) -> Figure:
    y, u = parts.outputs(data), parts.inputs(data)
    rows, traces = list[Row](), list[Trace]()
    other = next(iter(models)).partition(", fit")[0] if len(models) == 1 else "model"
    for k, quantity in enumerate(y):
        measured = np.where(data.observed[:, k], data.y[:, k], np.nan)
        traces.append(_line(data, measured, quantity, named, style.INK, len(rows), k == 0))
        for name, run in models.items():
            traces.append(_line(data, run[:, k], quantity, name, colours[name], len(rows), k == 0))
        rows.append(Row(quantity.label, "output", 1.5))
    for k, quantity in enumerate(y):
        for name, run in models.items():
            error = data.y[:, k] - run[:, k]
            traces.append(_line(data, error, quantity, name, colours[name], len(rows), legend=False, width=1.0))
        rows.append(Row(quantity.label, f"error, {named} minus {other}", 0.8))
    for k, quantity in enumerate(u):
        traces.append(_line(data, data.u[:, k], quantity, "input", style.INPUT, len(rows), legend=False, steps=True))
        rows.append(Row(quantity.label, "input", 0.6))
    figure = parts.stacked(traces, rows, TIME)
    figure["layout"]["shapes"] += parts.borders(data)
    _open_on_the_data(figure, data, models, y)
    return figure


def _line(
    data: IOData,
    values: np.ndarray,
    quantity: Quantity,
    name: str,
    colour: str,
    row: int,
    legend: bool,
    width: float = 1.5,
    steps: bool = False,
) -> Trace:
    shown = parts.times(values, quantity.factor)
    return parts.line(data.t, shown, name, colour, quantity.unit, row, data.lengths, steps, legend, width)


def _open_on_the_data(figure: Figure, data: IOData, models: Mapping[str, np.ndarray], y: list[Quantity]) -> None:
    """Ranges of the panels at first, and buttons, where a run leaves the data far; else plotly's own ranges."""
    near, whole, said = dict[str, Any](), dict[str, Any](), list[str]()
    for k, quantity in enumerate(y):
        for name, run in models.items():
            left = departure(data.y[:, k], run[:, k])
            if left is None:
                continue
            said.append(left.sentence(name.partition(", fit")[0], data.Ts, quantity))
            low, high = frame(data.y[:, k])
            span = [low * quantity.factor, high * quantity.factor]
            half = 0.5 * (span[1] - span[0])
            for row, limits in ((k, span), (len(y) + k, [-half, half])):
                axis = parts.axis(row).replace("y", "yaxis")
                near |= {f"{axis}.range": limits, f"{axis}.autorange": False}
                whole |= {f"{axis}.autorange": True}
                figure["layout"][axis] |= {"range": limits, "autorange": False}
    if not said:
        return
    buttons = [
        {"label": "near the data", "method": "relayout", "args": [near]},
        {"label": "whole run", "method": "relayout", "args": [whole]},
    ]
    place = {"x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom", "pad": {"b": 24}}
    figure["layout"]["updatemenus"] = [{"type": "buttons", "direction": "right", "buttons": buttons, **place}]
    figure["layout"]["margin"]["t"] += 34
    figure["layout"]["meta"] = {"said": " ".join(dict.fromkeys(said))}

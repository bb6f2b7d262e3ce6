"""The figures and tables of `qpal run`: models over a record, their differences, and their fits."""

from dataclasses import replace

import numpy as np

from sysid.base import style
from sysid.base.quantities import Quantity, display_quantity, number, percent, unit_of_channel
from sysid.data.record import IOData
from sysid.diagnosis.finding import channel
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel, scaled
from sysid.plots.free_runs import MEASURED, Run, free_runs_figure, output
from sysid.plots.records import Signal, stack_figure
from sysid.report.page import Grid
from sysid.workflow.input_run import InputRun
from sysid.workflow.model_run import ModelRun, Models, criteria_of
from sysid.workflow.saved import one_output

SHOWN = 6  # models that get a line in the overlay, and a panel of their own


def run_tables(result: ModelRun | InputRun) -> list[Grid]:
    """Fit and error of each output, or the range of each that has no measurement."""
    if isinstance(result, InputRun):
        shown = [(y.name, scaled(run, y.factor), y.unit) for y, run in _runs(result)]
        rows = [[name, number(float(run.min())), number(float(run.max())), unit] for name, run, unit in shown]
        return [Grid(["output", "smallest", "largest", "unit"], rows)]
    a, rows = result.ahead, []
    of_ahead = a is not None and result.growth is not None  # whose free run says nothing
    percents, errors = (a.percents, a.rmse) if a is not None and of_ahead else (result.percents, result.rmse)
    for j, (fit, rmse) in enumerate(zip(percents, errors, strict=True)):
        record = one_output(result.data, j)
        y = display_quantity(record.y_name, record.y_unit)
        row = [record.y_name or "y", percent(fit), number(rmse * y.factor), y.unit]
        row += [] if a is None or of_ahead else [percent(a.percents[j])]
        rows.append(row if a is None else [*row, percent(a.held[j])])
    ahead = "" if a is None else f"{a.horizon} ahead"
    heads = ["output", *([ahead, f"RMS error {ahead}"] if of_ahead else ["free run", "RMS error"]), "unit"]
    heads += [] if a is None else ["last output held"] if of_ahead else [ahead, "last output held"]
    return [Grid(heads, rows)]


def _runs(result: InputRun) -> list[tuple[Quantity, np.ndarray]]:
    """Each output of the run, as it is shown."""
    pairs = zip(outputs(result.data), result.output.T, strict=True)
    return [(display_quantity(e.y_name, e.y_unit), run) for e, run in pairs]


def input_run_figure(result: InputRun) -> Figure:
    """Each input, and each output of the run."""
    data = result.data
    inputs = [
        (display_quantity(channel(data, "u", i), unit_of_channel(data.u_unit, i)), u) for i, u in enumerate(data.u.T)
    ]
    signals = [Signal(quantity, u, "input", style.INPUT, steps=True) for quantity, u in inputs]
    signals += [Signal(quantity, run, "free run", style.MODEL) for quantity, run in _runs(result)]
    return stack_figure(data.t, signals)


def run_figure(result: ModelRun) -> Figure:
    """Each output with its free run, and the difference of all."""
    parts = outputs(result.data)
    of = [f" of {e.y_name}" if len(parts) > 1 else "" for e in parts]  # one legend names the lines of all panels
    runs = [Run(e, result.output[:, j], result.percents[j], e.y_name, f"free run{of[j]}") for j, e in enumerate(parts)]
    units = dict.fromkeys(output(e).unit for e in parts)
    unit = Quantity("difference", ", ".join(units))
    colours = (style.SECOND, *style.COLOURS)
    differences = [
        Line(
            e.t,
            scaled(e.y[:, 0] - result.output[:, j], output(e).factor),
            e.y_name,
            colours[j % len(colours)],
            0.9,
            key=len(parts) > 1,
        )
        for j, e in enumerate(parts)
    ]
    figure = free_runs_figure(runs)
    panel = Panel(differences, Axis.of(unit), Axis.time(), "measured minus free run")
    return replace(figure, panels=[*figure.panels, panel], height=2.2 + 2.0 * len(parts))


def prediction_figure(result: ModelRun) -> Figure:
    """Each output with its prediction."""
    assert result.ahead is not None
    a, label = result.ahead, f"{result.ahead.horizon} sample(s) ahead"
    return free_runs_figure(
        [
            Run(e, a.output[:, j], a.percents[j], f"{e.y_name}: prediction, NOT a free run", label)
            for j, e in enumerate(outputs(result.data))
        ]
    )


def outputs(data: IOData) -> list[IOData]:
    """The record with each of its outputs alone."""
    return [one_output(data, j) for j in range(data.y.shape[1])]


def models_tables(result: Models) -> list[Grid]:
    """One row for each model, the best one first."""
    rows = []
    for run in result.runs:
        fit, was = run.model.fit, run.model.estimation
        rows.append(
            (
                "best" if run is result.best and run.judged_fit > 0.0 else "",
                run.model.name,
                fit.model.structure.replace("_", " "),
                ",".join(map(str, run.model.as_dict()["orders"].values())) or "–",
                str(fit.criteria.d),
                f"{fit.Ts:g}",
                "–" if was is None else percent(was),
                percent(run.judged_fit),
                number(fit.criteria.fpe),
                number(fit.criteria.aic),
                criteria_of(run),
            )
        )
    heads = (
        "",
        "model",
        "structure",
        "orders",
        "d",
        "Ts [s]",
        "estimation",
        this_record(result),
        "FPE",
        "AIC",
        "criteria of",
    )
    caption = (
        f"Fit of the {result.best.judged} on this record; d is the effective number of parameters; FPE and AIC are "
        "those of the estimation data"
    )
    return [Grid(heads, rows, caption, text_columns=4, last_text=True)]


def this_record(result: Models) -> str:
    """The heading of the fits to this record: of predictions where no free run follows it."""
    return "this record" if result.best.growth is None else f"this record, {result.best.judged}"


def judged_output(run: ModelRun) -> tuple[np.ndarray, tuple[float, ...]]:
    """What a model is judged by (N, ny), a free run or a prediction, with its fits [%]."""
    if run.growth is None or run.ahead is None:
        return run.output, run.percents
    return run.ahead.output, run.ahead.percents


def overlay_figure(result: Models) -> Figure:
    """Measured output and what all models are judged by, one panel for each output."""
    panels = list[Panel]()
    for j, e in enumerate(outputs(result.best.data)):
        y = output(e)
        items: list[Item] = [Line(e.t, scaled(e.y[:, 0], y.factor), MEASURED, style.INK, 1.8)]
        for run, colour in zip(result.runs[:SHOWN], style.COLOURS, strict=False):
            shown, percents = judged_output(run)
            name = f"{run.model.name}, fit {percent(percents[j])}"
            items.append(Line(run.data.t, scaled(shown[:, j], y.factor), name, colour, 1.0))
        panels.append(Panel(items, Axis.of(y), Axis.time(), weight=1.8))
    return Figure(panels, height=0.8 + 3.0 * len(panels))

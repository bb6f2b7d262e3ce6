"""The pages of `qpal run`: one or several saved models beside a new record."""

from dataclasses import replace

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import Quantity, capital, display_quantity, number, percent
from sysid.data.record import IOData
from sysid.diagnosis.finding import channel
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel, scaled
from sysid.plots.free_runs import MEASURED, Run, free_runs_figure, output
from sysid.plots.records import Signal, stack_figure
from sysid.plots.residual_tests import residuals_figure
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.verdict import residuals_in_words
from sysid.workflow.input_run import InputRun
from sysid.workflow.model_run import CLOSE, ModelRun, Models, comparable, criteria_of
from sysid.workflow.saved import one_output

SHOWN = 6  # models that get a line in the overlay, and a panel of their own


def run_page(result: ModelRun | InputRun) -> Page:
    """The whole report."""
    if isinstance(result, InputRun):
        picture = Picture.of("free-run", input_run_figure(result), "The input, and the model's run from rest.")
        section = Section("Free run", tables=run_tables(result), pictures=[picture])
        return Page(*_title(result), run_sentences(result), [section], versions())
    n, data = result.n_init, result.data
    caption = (
        f"Measured output, the model's free run, and their difference. The free run uses only the input and the first "
        f"{n} outputs, which give its initial state and are not scored. A good model leaves a difference that looks "
        "like noise and keeps no trace of the input."
    )
    sections = [
        Section("Free run", tables=run_tables(result), pictures=[Picture.of("free-run", run_figure(result), caption)])
    ]
    if result.ahead is not None:
        k = result.ahead.horizon
        caption = (
            f"NOT a free run: each output is predicted from the measured ones up to {k} sample(s) "
            f"({k * data.Ts:g} s) before it. Near samples of a smooth output are alike, so compare its fit with that "
            "of holding the last measured output, not with that of the free run."
        )
        picture = Picture.of("prediction", prediction_figure(result), caption)
        sections.append(Section(f"Prediction {k} sample(s) ahead", [_prediction_method(result)], pictures=[picture]))
    if result.tests is not None:
        caption = f"{tests_in_words(result)} {result.tests.rule}"
        picture = Picture.of("residuals", residuals_figure(result.tests), caption)
        sections.append(Section("Residual tests", pictures=[picture]))
    return Page(*_title(result), run_sentences(result), sections, versions())


def _title(result: ModelRun | InputRun) -> tuple[str, str]:
    structure, data = result.model.fit.model.structure.replace("_", " "), result.data
    title = f"{result.model.path.name} on {result.record.path.name}"
    return title, f"{structure}; {data.N} samples, Ts {data.Ts:g} s"


def run_sentences(result: ModelRun | InputRun) -> list[str]:
    """How well the model follows the record, what to know about it, and what to do next."""
    if isinstance(result, InputRun):
        return [f"{capital(note)}." for note in result.notes]
    was = result.model.estimation
    lines = [
        f"In free run the model follows the record to {percent(result.percent)}"
        + ("." if was is None else f" ({percent(was)} on its estimation data).")
    ]
    if result.ahead is not None:
        a = result.ahead
        lines.append(
            f"Predicted {a.horizon} sample(s) ahead from measured outputs: {percent(float(np.mean(a.percents)))}; "
            f"the last measured output held gives {percent(float(np.mean(a.held)))}."
        )
        if np.mean(a.percents) < np.mean(a.held):
            lines.append(
                "So the model does not help to predict here: its residuals on this record are not those of its "
                "estimation data."
            )
    lines += [tests_in_words(result)] if result.tests is not None else []
    lines += [f"Note: {note}." for note in result.notes]
    return lines + ([result.next.sentence()] if result.next is not None else [])


def tests_in_words(result: ModelRun) -> str:
    """Whether the residuals of the free run are noise and tell nothing of the input."""
    t = result.tests
    assert t is not None
    return f"The residuals of the free run are {residuals_in_words(t)}."


def run_tables(result: ModelRun | InputRun) -> list[Grid]:
    """Fit and error of each output, or the range of each that has no measurement."""
    if isinstance(result, InputRun):
        shown = [(y.name, scaled(run, y.factor), y.unit) for y, run in _runs(result)]
        rows = [[name, number(float(run.min())), number(float(run.max())), unit] for name, run, unit in shown]
        return [Grid(["output", "smallest", "largest", "unit"], rows)]
    a, rows = result.ahead, []
    for j, (fit, rmse) in enumerate(zip(result.percents, result.rmse, strict=True)):
        record = one_output(result.data, j)
        y = display_quantity(record.y_name, record.y_unit)
        row = [record.y_name or "y", percent(fit), number(rmse * y.factor), y.unit]
        rows.append(row if a is None else [*row, percent(a.percents[j]), percent(a.held[j])])
    heads = ["output", "free run", "RMS error", "unit"]
    heads += [] if a is None else [f"{a.horizon} ahead", "last output held"]
    return [Grid(heads, rows)]


def _prediction_method(result: ModelRun) -> str:
    """How the model predicts, in words."""
    from sysid.estimation.result import Fit

    assert result.ahead is not None
    k = result.ahead.horizon
    fit = result.model.fit
    if not isinstance(fit, Fit):
        return (
            f"A nonlinear ARX model predicts one sample from measured outputs; {k} samples ahead it puts its own "
            "predictions in place of the outputs that it must not know."
        )
    if fit.predicts:
        return "An ARMAX model predicts by its own state estimator, from all measured outputs before."
    source = "this record, because the model's file holds none" if fit.noise is None else "the estimation data"
    return (
        "The model has no noise model of its own, so the prediction is the free run plus the forecast of its past "
        f"residuals by an autoregression, which is that of the residuals of {source} (Ljung, System Identification, "
        "1999, section 3.2). With white residuals it is the free run."
    )


def _runs(result: InputRun) -> list[tuple[Quantity, np.ndarray]]:
    """Each output of the run, as it is shown."""
    outputs = _outputs(result.data)
    return [(display_quantity(e.y_name, e.y_unit), run) for e, run in zip(outputs, result.output.T, strict=True)]


def input_run_figure(result: InputRun) -> Figure:
    """Each input, and each output of the run."""
    data = result.data
    inputs = [(display_quantity(channel(data, "u", i), data.u_unit), u) for i, u in enumerate(data.u.T)]
    signals = [Signal(quantity, u, "input", style.INPUT, steps=True) for quantity, u in inputs]
    signals += [Signal(quantity, run, "free run", style.MODEL) for quantity, run in _runs(result)]
    return stack_figure(data.t, signals)


def run_figure(result: ModelRun) -> Figure:
    """Each output with its free run, and the difference of all."""
    parts = _outputs(result.data)
    of = [f" of {e.y_name}" if len(parts) > 1 else "" for e in parts]  # one legend names the lines of all panels
    runs = [Run(e, result.output[:, j], result.percents[j], e.y_name, f"free run{of[j]}") for j, e in enumerate(parts)]
    unit = display_quantity("difference", parts[0].y_unit)
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
            for j, e in enumerate(_outputs(result.data))
        ]
    )


def _outputs(data: IOData) -> list[IOData]:
    """The record with each of its outputs alone."""
    return [one_output(data, j) for j in range(data.y.shape[1])]


def models_page(result: Models) -> Page:
    """The whole report."""
    overlay = (
        "Measured output and the free runs of the models, best first. A free run uses only the input and the first "
        "outputs, which give its initial state and are not scored. Where all models leave the measurement together, "
        "they lack the same thing."
    )
    single_caption = "The same runs one by one. Look for the stretches where a model leaves the measurement."
    picture = Picture.of("overlay", overlay_figure(result), overlay)
    runs = [Run(one_output(r.data, 0), r.output[:, 0], r.percents[0], "", r.model.name) for r in result.runs[:SHOWN]]
    return Page(
        f"{len(result.runs)} models on {result.record.path.name}",
        f"{result.record.data.N} samples, Ts {result.record.data.Ts:g} s",
        models_sentences(result),
        [
            Section(
                "Models",
                tables=models_tables(result),
                pictures=[picture],
            ),
            Section(
                "One by one",
                pictures=[Picture.of("one-by-one", free_runs_figure(runs, colours=style.COLOURS), single_caption)],
            ),
        ],
        versions(),
    )


def models_sentences(result: Models) -> list[str]:
    """Which model is best, whether a smaller one does as well, and what to know of each."""
    best, smaller = result.best, result.smaller
    lines = [f"{best.model.name} follows the record best: {percent(best.percent)} in free run."]
    if not best.percent > 0.0:
        lines = [
            f"No model follows the record: none is better than the mean of the output; the least bad is "
            f"{best.model.name} with {percent(best.percent)} in free run."
        ]
    if smaller is not None:
        lines.append(
            f"{smaller.model.name} is within {CLOSE:g} points of it ({percent(smaller.percent)}) with "
            f"{smaller.model.fit.criteria.d} parameters in place of {best.model.fit.criteria.d}: prefer it."
        )
    if not comparable(result):
        lines.append(
            "FPE and AIC are not comparable here: they refer to records of other lengths, sampling times or units, or "
            "to errors of another kind."
        )
    if len(result.runs) > SHOWN:
        lines.append(f"The figures show the best {SHOWN} of {len(result.runs)} models.")
    lines += [f"Note: {note}." for note in result.notes]
    for run in result.runs:
        lines += [f"Note on {run.model.name}: {note}." for note in run.notes if note not in result.notes]
    return lines + ([best.next.sentence()] if best.next is not None else [])


def models_tables(result: Models) -> list[Grid]:
    """One row for each model, the best one first."""
    rows = []
    for run in result.runs:
        fit, was = run.model.fit, run.model.estimation
        rows.append(
            (
                "best" if run is result.best and run.percent > 0.0 else "",
                run.model.name,
                fit.model.structure.replace("_", " "),
                ",".join(map(str, run.model.as_dict()["orders"].values())) or "–",
                str(fit.criteria.d),
                f"{fit.Ts:g}",
                "–" if was is None else percent(was),
                percent(run.percent),
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
        "this record",
        "FPE",
        "AIC",
        "criteria of",
    )
    caption = "Fit of the free run; d is the number of free parameters; FPE and AIC are those of the estimation data"
    return [Grid(heads, rows, caption, text_columns=4, last_text=True)]


def overlay_figure(result: Models) -> Figure:
    """Measured output and all free runs, one panel for each output."""
    panels = list[Panel]()
    for j, e in enumerate(_outputs(result.best.data)):
        y = output(e)
        items: list[Item] = [Line(e.t, scaled(e.y[:, 0], y.factor), MEASURED, style.INK, 1.8)]
        for run, colour in zip(result.runs[:SHOWN], style.COLOURS, strict=False):
            name = f"{run.model.name}, fit {percent(run.percents[j])}"
            items.append(Line(run.data.t, scaled(run.output[:, j], y.factor), name, colour, 1.0))
        panels.append(Panel(items, Axis.of(y), Axis.time(), weight=1.8))
    return Figure(panels, height=0.8 + 3.0 * len(panels))

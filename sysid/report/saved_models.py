"""The pages of `qpal run`: one or several saved models beside a new record."""

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import capital, percent
from sysid.diagnosis.residuals import CLOSE
from sysid.plots.free_runs import Run, free_runs_figure
from sysid.plots.residual_tests import residuals_figure
from sysid.report.page import Page, Picture, Section
from sysid.report.saved_models_answer import of_models, of_run
from sysid.report.saved_models_parts import SHOWN, judged_output, models_tables, prediction_figure
from sysid.report.verdict import left_in_words
from sysid.workflow.input_run import InputRun
from sysid.workflow.model_run import ModelRun, Models, comparable
from sysid.workflow.saved import one_output


def run_page(result: ModelRun | InputRun) -> Page:
    """The whole report."""
    answer, sections = of_run(result), list[Section]()
    if isinstance(result, InputRun):
        return Page(*_title(result), run_sentences(result), sections, versions(), answer=answer)
    if result.ahead is not None:
        k = result.ahead.horizon
        caption = (
            f"NOT a free run: each output is predicted from the measured ones up to {k} sample(s) "
            f"({k * result.data.Ts:g} s) before it. Near samples of a smooth output are alike, so compare its fit with "
            "that of holding the last measured output, not with that of the free run."
        )
        picture = Picture.of("prediction", prediction_figure(result), caption)
        sections.append(Section(f"Prediction {k} sample(s) ahead", [_prediction_method(result)], pictures=[picture]))
    if result.tests is not None:
        caption = f"{tests_in_words(result)} {result.tests.rule}"
        picture = Picture.of("residuals", residuals_figure(result.tests), caption)
        sections.append(Section("Residual tests", pictures=[picture]))
    return Page(*_title(result), run_sentences(result), sections, versions(), answer=answer)


def _title(result: ModelRun | InputRun) -> tuple[str, str]:
    structure, data = result.model.fit.model.structure.replace("_", " "), result.data
    title = f"{result.model.path.name} on {result.record.path.name}"
    return title, f"{structure}; {data.N} samples, Ts {data.Ts:g} s"


def run_sentences(result: ModelRun | InputRun) -> list[str]:
    """How well the model follows the record, and what to know about it."""
    if isinstance(result, InputRun):
        return [f"{capital(note)}." for note in result.notes]
    was = result.model.estimation
    lines = [
        f"In free run the model follows the record to {percent(result.percent)}"
        + ("." if was is None else f" ({percent(was)} on its estimation data).")
        if result.growth is None
        else "The model does not settle: a free run adds up all errors and says nothing of it, so its prediction "
        f"{result.growth.ahead} is judged: {percent(result.growth.fit)}."
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
    return lines + [f"Note: {note}." for note in result.notes]


def tests_in_words(result: ModelRun) -> str:
    """Whether the residuals of the free run are noise and tell nothing of the input."""
    of = "of the free run" if result.growth is None else "one step ahead"
    return f"{capital(left_in_words(result.tests))} (residuals {of})."


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
        return "The model predicts by its own noise model, from all measured outputs before."
    source = "this record, because the model's file holds none" if fit.noise is None else "the estimation data"
    return (
        "The model has no noise model of its own, so the prediction is the free run plus the forecast of its past "
        f"residuals by an autoregression, which is that of the residuals of {source} (Ljung, System Identification, "
        "1999, section 3.2). With white residuals it is the free run."
    )


def models_page(result: Models) -> Page:
    """The whole report."""
    method = (
        "A free run uses only the input and the first outputs, which give its initial state and are not scored. Where "
        "all models leave the measurement together, they lack the same thing."
    )
    if result.best.growth is not None:
        method = (
            "No free run follows this record: it adds up every error where the plant does not settle. So all models "
            f"are judged by their {result.best.judged}, from the outputs measured before."
        )
    single_caption = "The same one by one. Look for the stretches where a model leaves the measurement."
    runs = []
    for r in result.runs[:SHOWN]:
        y, percents = judged_output(r)
        runs.append(Run(one_output(r.data, 0), y[:, 0], percents[0], "", r.model.name))
    return Page(
        f"{len(result.runs)} models on {result.record.path.name}",
        f"{result.record.data.N} samples, Ts {result.record.data.Ts:g} s",
        models_sentences(result),
        [
            Section("Models", [method], tables=models_tables(result)),
            Section(
                "One by one",
                pictures=[Picture.of("one-by-one", free_runs_figure(runs, colours=style.COLOURS), single_caption)],
            ),
        ],
        versions(),
        answer=of_models(result),
    )


def models_sentences(result: Models) -> list[str]:
    """Which model is best, whether a smaller one does as well, and what to know of each."""
    best, smaller = result.best, result.smaller
    judged = f"in {best.judged}" if best.growth is None else f"in {best.judged}, as no free run follows it"
    lines = [f"{best.model.name} follows the record best: {percent(best.judged_fit)} {judged}."]
    if not best.judged_fit > 0.0:
        lines = [
            f"No model follows the record: none is better than the mean of the output; the least bad is "
            f"{best.model.name} with {percent(best.judged_fit)} {judged}."
        ]
    if smaller is not None:
        lines.append(
            f"{smaller.model.name} is within {CLOSE:g} points of it ({percent(smaller.judged_fit)}) with "
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
    return lines

"""The page of `qpal run`: a saved model beside a new record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import display_quantity, number, percent
from sysid.base.style import styled
from sysid.plots import Run, free_runs, residual_tests
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.words import verdict
from sysid.workflow.model_run import ModelRun
from sysid.workflow.saved import one_output

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def page(result: ModelRun) -> Page:
    """The whole report."""
    n, data = result.n_init, result.data
    caption = (
        f"Measured output, the model's free run, and their difference. The free run uses only the input and the first "
        f"{n} outputs, which give its initial state and are not scored. A good model leaves a difference that looks "
        "like noise and keeps no trace of the input."
    )
    sections = [
        Section("Free run", tables=tables(result), pictures=[Picture("free-run", style.png(draw(result)), caption)])
    ]
    if result.ahead is not None:
        k = result.ahead.horizon
        caption = (
            f"NOT a free run: each output is predicted from the measured ones up to {k} sample(s) "
            f"({k * data.Ts:g} s) before it. Near samples of a smooth output are alike, so compare its fit with that "
            "of holding the last measured output, not with that of the free run."
        )
        picture = Picture("prediction", style.png(draw_ahead(result)), caption)
        sections.append(Section(f"Prediction {k} sample(s) ahead", [_how(result)], pictures=[picture]))
    if result.tests is not None:
        caption = (
            f"{tests_in_words(result)} A complete model leaves only noise and stays inside the "
            f"{result.tests.level:.0%} bounds."
        )
        drawn = Picture("residuals", style.png(residual_tests(result.tests)), caption)
        sections.append(Section("Residual tests", pictures=[drawn]))
    return Page(
        f"{result.model.path.name} on {result.record.path.name}",
        f"{result.model.fit.model.structure.replace('_', ' ')}; {data.N} samples, Ts {data.Ts:g} s",
        sentences(result),
        sections,
        versions(),
    )


def sentences(result: ModelRun) -> list[str]:
    """How well the model follows the record, what to know about it, and what to do next."""
    was = result.model.estimation
    said = [
        f"In free run the model follows the record to {percent(result.percent)}"
        + ("." if was is None else f" ({percent(was)} on its estimation data).")
    ]
    if result.ahead is not None:
        a = result.ahead
        said.append(
            f"Predicted {a.horizon} sample(s) ahead from measured outputs: {percent(float(np.mean(a.percents)))}; "
            f"the last measured output held gives {percent(float(np.mean(a.held)))}."
        )
        if np.mean(a.percents) < np.mean(a.held):
            said.append(
                "So the model does not help to predict here: its residuals on this record are not those of its "
                "estimation data."
            )
    said += [tests_in_words(result)] if result.tests is not None else []
    said += [f"Note: {note}." for note in result.notes]
    return said + ([result.next.sentence()] if result.next is not None else [])


def tests_in_words(result: ModelRun) -> str:
    """Whether the residuals of the free run are noise and tell nothing of the input."""
    t = result.tests
    assert t is not None
    return f"The residuals of the free run are {verdict(t)}."


def tables(result: ModelRun) -> list[Grid]:
    """Fit and error of each output."""
    a, rows = result.ahead, []
    for j, (fit, rmse) in enumerate(zip(result.percents, result.rmse, strict=True)):
        own = one_output(result.data, j)
        y = display_quantity(own.y_name, own.y_unit)
        row = [own.y_name or "y", percent(fit), number(rmse * y.factor), y.unit]
        rows.append(row if a is None else [*row, percent(a.percents[j]), percent(a.held[j])])
    heads = ["output", "free run", "RMS error", "unit"]
    heads += [] if a is None else [f"{a.horizon} ahead", "last output held"]
    return [Grid(heads, rows)]


def _how(result: ModelRun) -> str:
    from sysid.estimation.result import Fit

    assert result.ahead is not None
    k = result.ahead.horizon
    fit = result.model.fit
    if not isinstance(fit, Fit):
        return (
            f"A nonlinear ARX model predicts one sample from measured outputs; {k} samples ahead it puts its own "
            "predictions in place of the outputs that it must not know."
        )
    where = "this record, because the model's file holds none" if fit.noise is None else "the estimation data"
    return (
        "The model has no noise model of its own, so the prediction is the free run plus the forecast of its past "
        f"residuals by an autoregression, which is that of the residuals of {where} (Ljung, System Identification, "
        "1999, section 3.2). With white residuals it is the free run."
    )


@styled
def draw(result: ModelRun) -> Sequence[Axes]:
    """Each output with its free run, and the difference of all."""
    outputs = range(result.data.y.shape[1])
    rows = style.panels(None, len(outputs) + 1, height=2.2 + 2.0 * len(outputs), sharex=True)
    parts = [one_output(result.data, j) for j in outputs]
    free_runs(
        [Run(e, result.output[:, j], result.percents[j], e.y_name) for j, e in zip(outputs, parts, strict=True)],
        rows[:-1],
        time="",
    )
    unit = display_quantity("difference", parts[0].y_unit)
    for j, e in zip(outputs, parts, strict=True):
        difference = (e.y[:, 0] - result.output[:, j]) * display_quantity("", e.y_unit).factor
        style.line(rows[-1], e.t, difference, linewidth=0.9, color=style.SECOND if j == 0 else None, label=e.y_name)
    rows[-1].set(title="measured minus free run", xlabel="time [s]", ylabel=unit.label)
    if len(outputs) > 1:
        style.legend(rows[-1])
    return rows


@styled
def draw_ahead(result: ModelRun) -> Sequence[Axes]:
    """Each output with its prediction."""
    assert result.ahead is not None
    k = result.ahead.horizon
    parts = [one_output(result.data, j) for j in range(result.data.y.shape[1])]
    return free_runs(
        [
            Run(
                e,
                result.ahead.output[:, j],
                result.ahead.percents[j],
                f"{e.y_name}: prediction, NOT a free run",
                f"{k} sample(s) ahead",
            )
            for j, e in enumerate(parts)
        ]
    )

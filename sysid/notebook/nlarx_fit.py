"""A nonlinear ARX fit at a prompt and in a notebook."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from sysid.base.card import Card
from sysid.base.errors import InputError, unknown
from sysid.base.quantities import percent
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.nlarx.result import NlarxFit
from sysid.notebook.figures import figure
from sysid.notebook.fit import SAY, parameter_table
from sysid.notebook.page import write_page
from sysid.notebook.words import criteria_in_words, rmse_in_words, search_in_words, structure_in_words
from sysid.plots.free_runs import fitted
from sysid.plots.residual_tests import residual_tests

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = ("output", "residuals")


def line(fit: NlarxFit) -> str:
    """Structure, error and size."""
    words = structure_in_words(fit)
    return f"<NlarxFit: {words}; RMSE {rmse_in_words(fit)} {fit.criteria_of}, d {fit.criteria.d}>"


def card(fit: NlarxFit) -> Card:
    """One screen; both kinds of fit need the record."""
    data = fit.record
    facts = [("sampling", f"every {fit.Ts:g} s, {fit.criteria.N} samples")]
    sentences = []
    if data is not None:
        facts.append(("fit, free run", f"{percent(fit.fit_percent(data))} on its own record"))
        facts.append(
            ("fit, one step ahead", f"{percent(fit.prediction_percent(data))}; never compare it with a free run")
        )
        sentences += [f"{text[0].upper()}{text[1:]}." for text in [fit.divergence(data)] if text]
    facts += [
        ("RMSE", f"{rmse_in_words(fit)}, {fit.criteria_of}"),
        ("criteria", criteria_in_words(fit)),
        ("search", search_in_words(fit)),
        ("poles", "none: see sysid.nlarx.linearize for the tangent at an operating point"),
    ]
    sentences += [f"Warning: {text}." for text in fit.warnings[:3]]
    calls = "fit.plot(), fit.plot(what='residuals'), fit.parameters, fit.report('fit.html')"
    return Card(structure_in_words(fit), facts, (), sentences, [parameter_table(fit)], call=f"Next: {calls}")


def plot(fit: NlarxFit, data: IOData | None, what: str, at: float | None = None) -> Figure:
    """The figure `what`; it has no operating point."""
    if what not in FIGURES:
        raise unknown("figure of a nonlinear ARX model", what, FIGURES)
    if at is not None:
        raise InputError("figures of a nonlinear ARX model have no operating point; see sysid.linear.tangent(fit, u)")
    data = fit.record_or(data)
    if what == "residuals":
        return figure(residual_tests, fit.residual_tests(data), say=SAY[what])
    run, fits = fit.simulate(data) + data.y_offset, [fit.fit_percent(data)]
    return figure(fitted, retrend(data), run, fits, skipped=max(fit.n_init, fit.model.lag), say=SAY[what])


def report(fit: NlarxFit, path: str | PathLike, data: IOData | None, validation: IOData | None) -> Path:
    """The page of `qpal identify`."""
    return write_page(fit, path, fit.record_or(data), validation)


def refine(fit: NlarxFit, data: IOData | None, **options: Any) -> NoReturn:
    """A nonlinear ARX model takes no start."""
    raise InputError(
        "a nonlinear ARX fit takes no start; fit it again with more: sysid.fit_nlarx(fit.model, data, starts=10)"
    )


def noise_model(fit: NlarxFit, data: IOData | None) -> NoReturn:
    """Its residuals are those of a predictor that models the noise itself."""
    raise InputError("a nonlinear ARX model predicts its noise from past outputs; see fit.residual_tests(data)")


def modes(fit: NlarxFit, data: IOData | None) -> NoReturn:
    """It has poles at an operating point only."""
    raise InputError("a nonlinear ARX model has poles at an operating point only; see sysid.linear.tangent(fit, u)")

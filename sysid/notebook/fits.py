"""What fits show at a prompt and in a notebook, and what they do there, one class each."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.quantities import capital, number, percent
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.estimation.origin import check_units
from sysid.estimation.result import Fit
from sysid.fitting import fit as fit_model
from sysid.linear.modes import Modes
from sysid.linear.modes import modes as modes_of
from sysid.linear.noise import Noise
from sysid.linear.noise import noise_model as noise_model_of
from sysid.nlarx.result import NlarxFit
from sysid.notebook.card import Card, Table
from sysid.notebook.page import (
    criteria_in_words,
    figure,
    rmse_in_words,
    search_in_words,
    structure_in_words,
    write_page,
)
from sysid.notebook.poles import doubts, gain_fact, noise_of, pole_table
from sysid.notebook.poles import modes_of as modes_with_words
from sysid.plots.free_runs import fitted
from sysid.plots.pole_zero import pole_zero_map
from sysid.plots.residual_tests import residual_tests
from sysid.plots.responses import bode, step
from sysid.plots.static_maps import static_maps
from sysid.uncertainty import curves, intervals, responses
from sysid.uncertainty.information import Information, information

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = ("output", "residuals", "poles", "bode", "step", "maps")
TANGENTS = ("bode", "step")
WARNINGS = 3  # on a card
_SAME = 1.0 + 1e-9  # two errors that differ by rounding
SAY = {
    "output": "What to see: the free run (only the input, no measured outputs) covers the measured output, and the "
    "error below looks like noise. Shaded: samples that give the initial state.",
    "residuals": "What to see: dots inside the shaded bound. Outside in (a): missing dynamics or coloured noise; "
    "outside in (b) at positive lags: the model misses what the input does.",
    "poles": "What to see: regions inside the unit circle, so that the model is stable for certain; a pole on a zero "
    "means that a lower order may do.",
    "bode": "What to see: a narrow band where the record has power; where the band is wide the record does not tell.",
    "step": "What to see: the final value is the DC gain; the band says how well the record determines it.",
    "maps": "What to see: a map off the dashed diagonal is a nonlinearity; a wide band has few samples behind it.",
}
NLARX_FIGURES = ("output", "residuals")


class FitView:
    """A chain's fit."""

    @staticmethod
    def line(fit: Fit) -> str:
        """Structure, fit where the record is known, error and size; nothing is simulated."""
        score = own_percent(fit)
        fits = "" if score is None else f"fit {percent(score)}, "
        return f"<Fit: {structure_in_words(fit)}; {fits}RMSE {rmse_in_words(fit)}, d {fit.criteria.d}>"

    @staticmethod
    def card(fit: Fit) -> Card:
        """One screen; the residual tests and the noise model need the record."""
        data = fit.record
        facts = [("sampling", f"every {fit.Ts:g} s, {fit.criteria.N} samples")]
        score = own_percent(fit)
        if score is not None:
            facts.append(("fit, free run", f"{percent(score)} on its own record"))
        elif data is not None and data.y.shape[1] > 1:
            fits = fit.fit_percents(data)
            score, percentages = float(np.mean(fits)), ", ".join(percent(float(value)) for value in fits[:6])
            facts.append(("fit, free run", f"{percentages} of its own outputs in turn"))
        facts += [
            ("RMSE", rmse_in_words(fit)),
            ("criteria", criteria_in_words(fit)),
            ("search", search_in_words(fit)),
        ]
        if (gain := gain_fact(fit, data)) is not None:
            facts.append(gain)
        noise = noise_of(fit, data)
        sentences = [] if noise is None else [noise.sentence()]
        sentences += [f"Warning: {text}." for text in fit.warnings[:WARNINGS]]
        poles, assumption = modes_with_words(fit, data)
        table = pole_table(poles, assumption)
        calls = "fit.plot(), fit.parameters, fit.residual_tests(data), fit.refine(), fit.report('fit.html')"
        return Card(
            structure_in_words(fit),
            facts,
            [table] if table is not None else [],
            sentences,
            [parameter_table(fit)],
            call=f"Next: {calls}",
            first=doubts(fit, data, score, poles),
        )

    @staticmethod
    def plot(fit: Fit, data: IOData | None, what: str, at: float | None = None) -> Figure:
        """The figure `what`, of a tangent at the constant input `at`."""
        if what not in FIGURES:
            raise unknown("figure", what, FIGURES)
        if at is not None and what not in TANGENTS:
            raise InputError(f"at= chooses the operating point of {' and '.join(TANGENTS)}; leave it out for {what}")
        if what == "poles" and data is None and fit.record is None:
            return figure(pole_zero_map, fit.poles, fit.zeros, say=SAY[what])
        data = fit.record_or(data)
        if what == "output":
            run, fits = fit.simulate(data) + data.y_offset, fit.fit_percents(data)
            return figure(fitted, retrend(data), run, fits, skipped=fit.n_init, say=SAY[what])
        if what == "residuals":
            return figure(residual_tests, fit.residual_tests(data), say=SAY[what])
        info = information(fit, data, lags="tested")
        if what == "poles":
            return figure(pole_zero_map, intervals.poles(info), intervals.zeros(info), say=SAY[what])
        if what == "maps":
            maps = curves.curves(info)
            if not maps:
                raise InputError(
                    "this model has no static map; choose another figure, for example fit.plot(data, 'bode')"
                )
            return figure(static_maps, maps, say=SAY[what])
        point = _level(info) if at is None else float(at)
        units = {"y_unit": data.y_unit, "u_unit": data.u_unit}
        if what == "bode":
            return figure(bode, responses.frequency(info, point), **units, say=SAY[what])
        return figure(step, responses.step(info, point), **units, y_name=data.y_name, say=SAY[what])

    @staticmethod
    def report(fit: Fit, path: str | PathLike, data: IOData | None, validation: IOData | None) -> Path:
        """The page of `qpal identify`."""
        return write_page(fit, path, fit.record_or(data), validation)

    @staticmethod
    def refine(fit: Fit, data: IOData | None, **options: Any) -> Fit:
        """A further search from this fit."""
        if "start" in options or "starts" in options:
            raise InputError("refine starts from the fit itself; leave start and starts out, or use sysid.fit")
        record = fit.record_or(data)
        check_units(record, fit.origin)
        new = fit_model(fit.model, record, start=fit, **options)
        # The fit keeps the initial state of its first experiment: those of the others are searched again.
        if (
            record is not fit.record
            or options.get("objective") is not None
            or new.criteria.mse <= _SAME * fit.criteria.mse
        ):
            return new
        text = (
            f"a further search ended at a mean square error of {new.criteria.mse:.4g}, above {fit.criteria.mse:.4g}: "
            "this is the fit that it began from"
        )
        return replace(fit, warnings=(*(w for w in fit.warnings if w[:16] != text[:16]), text)).remember(record)

    @staticmethod
    def noise_model(fit: Fit, data: IOData | None) -> Noise:
        """The colour of the residuals."""
        return noise_model_of(fit, fit.record_or(data))

    @staticmethod
    def modes(fit: Fit, data: IOData | None) -> Modes:
        """The poles; without any record with the fit's own covariance."""
        if data is None and fit.record is not None and fit.model.channels == (1, 1):
            data = fit.record  # a robust covariance is that of one input and output
        return modes_of(fit, data)


def own_percent(fit: Fit) -> float | None:
    """Free-run fit [%] on the record of the fit with its fitted initial state, from the criteria; None if unknown."""
    data = fit.record
    if data is None or data.y.shape[1] != 1:
        return None
    y = data.y[data.observed[:, 0], 0]
    spread = float(np.std(y))
    return 100.0 * (1.0 - float(np.sqrt(fit.criteria.mse)) / spread) if spread > 0.0 else None


def parameter_table(fit: Any) -> Table:
    """Every parameter with its standard deviation."""
    rows = [
        (p.name, number(p.value, 5), number(p.std, 2), p.unit or "–", "free" if p.free else "fixed")
        for p in fit.parameters
    ]
    return Table(("parameter", "value", "std", "unit", ""), rows, f"{len(rows)} parameters with standard deviations")


def _level(info: Information) -> float:
    """The operating point: 0, or the middle of the input's range where that does not hold 0."""
    low, high = float(info.data.u.min()), float(info.data.u.max())
    return 0.0 if low <= 0.0 <= high else 0.5 * (low + high)


class NlarxFitView:
    """A nonlinear ARX fit, which takes no start and has poles at an operating point only."""

    @staticmethod
    def line(fit: NlarxFit) -> str:
        """Structure, error and size."""
        words = structure_in_words(fit)
        return f"<NlarxFit: {words}; RMSE {rmse_in_words(fit)} {fit.criteria_of}, d {fit.criteria.d}>"

    @staticmethod
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
            sentences += [f"{capital(text)}." for text in [fit.divergence(data)] if text]
        facts += [
            ("RMSE", f"{rmse_in_words(fit)}, {fit.criteria_of}"),
            ("criteria", criteria_in_words(fit)),
            ("search", search_in_words(fit)),
            ("poles", "none: see sysid.nlarx.linearize for the tangent at an operating point"),
        ]
        sentences += [f"Warning: {text}." for text in fit.warnings[:3]]
        calls = "fit.plot(), fit.plot(what='residuals'), fit.parameters, fit.report('fit.html')"
        return Card(structure_in_words(fit), facts, (), sentences, [parameter_table(fit)], call=f"Next: {calls}")

    @staticmethod
    def plot(fit: NlarxFit, data: IOData | None, what: str, at: float | None = None) -> Figure:
        """The figure `what`; it has no operating point."""
        if what not in NLARX_FIGURES:
            raise unknown("figure of a nonlinear ARX model", what, NLARX_FIGURES)
        if at is not None:
            raise InputError(
                "figures of a nonlinear ARX model have no operating point; see sysid.linear.tangent(fit, u)"
            )
        data = fit.record_or(data)
        if what == "residuals":
            return figure(residual_tests, fit.residual_tests(data), say=SAY[what])
        run, fits = fit.simulate(data) + data.y_offset, [fit.fit_percent(data)]
        return figure(fitted, retrend(data), run, fits, skipped=max(fit.n_init, fit.model.lag), say=SAY[what])

    @staticmethod
    def report(fit: NlarxFit, path: str | PathLike, data: IOData | None, validation: IOData | None) -> Path:
        """The page of `qpal identify`."""
        return write_page(fit, path, fit.record_or(data), validation)

    @staticmethod
    def refine(fit: NlarxFit, data: IOData | None, **options: Any) -> NoReturn:
        """A nonlinear ARX model takes no start."""
        raise InputError(
            "a nonlinear ARX fit takes no start; fit it again with more: sysid.fit_nlarx(fit.model, data, starts=10)"
        )

    @staticmethod
    def noise_model(fit: NlarxFit, data: IOData | None) -> NoReturn:
        """Its residuals are those of a predictor that models the noise itself."""
        raise InputError("a nonlinear ARX model predicts its noise from past outputs; see fit.residual_tests(data)")

    @staticmethod
    def modes(fit: NlarxFit, data: IOData | None) -> NoReturn:
        """It has poles at an operating point only."""
        raise InputError("a nonlinear ARX model has poles at an operating point only; see sysid.linear.tangent(fit, u)")

"""Several inputs and outputs: their tests, and what a figure of one input and one output shows of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base.criteria import fit_percent
from sysid.data.record import IOData
from sysid.diagnosis.residuals import ResidualTests, residual_tests
from sysid.estimation.result import Fit
from sysid.nlarx.result import NlarxFit

if TYPE_CHECKING:
    from sysid.channels.signals import Signals
    from sysid.workflow.evaluation import Evaluation


@dataclass(frozen=True)
class OneOutput:
    """One of several outputs: its free-run fits [%] of both parts, and the tests of its residuals with all inputs.

    Of the tests with the inputs, `tests` has that which speaks most against independence.
    """

    name: str
    unit: str
    estimation_fit: float
    validation_fit: float
    tests: ResidualTests | None

    def as_dict(self) -> dict[str, Any]:
        """The numbers, ready for JSON."""
        found: dict[str, Any] = {"name": self.name, "unit": self.unit}
        found["fit_percent"] = {"estimation": self.estimation_fit, "validation": self.validation_fit}
        return {**found, "residuals": self.tests.as_dict() if self.tests else None}


def is_several(data: IOData) -> bool:
    """Whether a record has more than one input or output."""
    return data.u.shape[1] > 1 or data.y.shape[1] > 1


def fits(data: IOData, run: np.ndarray, first: int = 0) -> np.ndarray:
    """Fit [%] of each output (ny,) of a run (N,) or (N, ny) over its measured samples from `first` on."""
    runs, seen = run.reshape(data.N, -1), data.observed
    seen = seen & (np.arange(data.N) >= first)[:, None]
    return np.array([fit_percent(y[k], x[k]) for y, x, k in zip(data.y.T, runs.T, seen.T, strict=True)])


def residuals_and_inputs(fit: Fit | NlarxFit, data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (M, ny) and inputs (M, nu) of all experiments, without their first samples."""
    es = [np.reshape(e, (len(e), -1)) for e in (fit.residuals(part) for part in data.experiments)]
    us = [part.u[part.N - len(e) :] for part, e in zip(data.experiments, es, strict=True)]
    return np.concatenate(es), np.concatenate(us)


def tests_of(fit: Fit, data: IOData) -> tuple[ResidualTests, ...]:
    """The tests of each output's residuals, with the input of which they are least independent."""
    e, u = residuals_and_inputs(fit, data)
    return tuple(worst([residual_tests(own, x) for x in u.T]) for own in e.T)


def worst(tests: Sequence[ResidualTests]) -> ResidualTests:
    """The whiteness test that is farthest outside its bound, beside the test that speaks most against independence."""
    white = max(tests, key=lambda t: float(np.max(np.abs(t.autocorrelation[1:])) / t.whiteness_bound))
    beside = min(tests, key=lambda t: t.independence_p)
    return replace(
        beside, lags=white.lags, autocorrelation=white.autocorrelation, whiteness_bound=white.whiteness_bound
    )


def named(e: Evaluation, signals: Signals) -> Evaluation:
    """The evaluation of several channels with the names and units of the file."""
    if not e.outputs:
        return e
    names = [_distinct([s.name for s in found], [s.column for s in found]) for found in (signals.input, signals.output)]
    outputs = zip(e.outputs, names[1], signals.output, strict=True)
    return replace(
        e,
        inputs=tuple((name, s.unit) for name, s in zip(names[0], signals.input, strict=True)),
        outputs=tuple(replace(output, name=name, unit=s.unit) for output, name, s in outputs),
    )


def _distinct(names: list[str], columns: list[str]) -> list[str]:
    """The names, or the columns where two names are one."""
    return names if len(set(names)) == len(names) else columns


def views(e: Evaluation, section: str) -> list[tuple[str, str, Evaluation]]:
    """What the figures of a section show of several channels: a mark for the name, words, and one input and output.

    "Data" has every channel, "Model output" and "Residual tests" every output, "Model" the evaluation as it is.
    """
    if not e.outputs or section == "Model":
        return [("", "", e)]
    ny = len(e.outputs)
    count = max(e.estimation.u.shape[1], ny) if section == "Data" else ny
    return [_view(e, k, section) for k in range(count)]


def _view(e: Evaluation, k: int, section: str) -> tuple[str, str, Evaluation]:
    i, j = min(k, e.estimation.u.shape[1] - 1), min(k, len(e.outputs) - 1)
    own = e.outputs[j]
    estimation, validation = (
        one_channel(data, i, j, e.inputs[i], (own.name, own.unit)) for data in (e.estimation, e.validation)
    )
    shown = replace(
        e,
        estimation=estimation,
        validation=validation,
        estimation_output=e.estimation_output.reshape(e.estimation.N, -1)[:, j],
        validation_output=e.validation_output.reshape(e.validation.N, -1)[:, j],
        estimation_fit=own.estimation_fit,
        validation_fit=own.validation_fit,
        tests=own.tests,
        outputs=(),
    )
    words = f"{e.inputs[i][0]} and {own.name}: " if section == "Data" else f"{own.name}: "
    return f"-{k + 1}", words, shown


def one_channel(data: IOData, i: int, j: int, u: tuple[str, str], y: tuple[str, str]) -> IOData:
    """One input and one output of a record, with their names and units."""
    return replace(
        data,
        u=data.u[:, i],
        y=data.y[:, j],
        u_name=u[0],
        y_name=y[0],
        u_unit=u[1],
        y_unit=y[1],
        u_offset=data.u_offset[i],
        y_offset=data.y_offset[j],
        missing=None if data.missing is None else data.missing[:, j],
    )

"""Several inputs and outputs: the fits and tests of each output."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.criteria import fit_percent
from sysid.data.record import IOData
from sysid.diagnosis.residuals import ResidualTests, residual_tests
from sysid.estimation.result import Fit
from sysid.nlarx.result import NlarxFit


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

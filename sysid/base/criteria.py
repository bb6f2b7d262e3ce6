"""Criteria of a fit: fit %, loss, MSE, FPE, AIC, AICc, nAIC, BIC (Ljung, System Identification, 2nd ed., ch. 16)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.base.quantities import number


@dataclass(frozen=True)
class Criteria:
    """Criteria of one fit: N samples, d free parameters after the gauge, initial states counted.

    loss is the minimised cost divided by N, without penalties (ridge, curvature): errors count with their weights, and
    errors beyond Huber's threshold count less. mse is V = e'e / N of the plain errors, in the unit of y squared, over
    all observed samples of all outputs; plain least squares has loss = mse. All criteria of `TABLE` follow from V, so
    that they can compare fits with different objectives; they are attributes too. A criterion that N does not allow
    (N <= d for FPE, N <= d + 1 for AICc) is infinite; a criterion with unknown V is nan.
    """

    loss: float
    mse: float
    N: int
    d: int

    def as_dict(self) -> dict[str, float]:
        """All values by name."""
        return {
            "loss": self.loss,
            "mse": self.mse,
            **{n: c.formula(self) for n, c in TABLE.items()},
            "N": self.N,
            "d": self.d,
        }

    def brief(self) -> dict[str, str]:
        """The criteria that stand beside a model where models are compared, by label, as people read them."""
        return {c.label: number(c.formula(self), 4 if c.squared else 6) for c in TABLE.values() if c.beside}

    def __getattr__(self, name: str) -> float:
        if name not in TABLE:
            raise AttributeError(
                f"there is no criterion {name!r}; choose one of {', '.join(TABLE)}, loss, mse, N and d"
            )
        return TABLE[name].formula(self)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *TABLE]


def _log(c: Criteria) -> float:
    return float(np.log(c.mse)) if c.mse != 0.0 else -np.inf


def _likelihood(c: Criteria) -> float:
    """-2 ln of the largest likelihood of Gaussian white errors."""
    return c.N * _log(c) + c.N * (np.log(2 * np.pi) + 1)


def _fpe(c: Criteria) -> float:
    return c.mse * (1 + c.d / c.N) / (1 - c.d / c.N) if c.d < c.N else np.inf


def _aic(c: Criteria) -> float:
    return _likelihood(c) + 2 * c.d


def _aicc(c: Criteria) -> float:
    return _aic(c) + 2 * c.d * (c.d + 1) / (c.N - c.d - 1) if c.d + 1 < c.N else np.inf


def _naic(c: Criteria) -> float:
    return _log(c) + 2 * c.d / c.N


def _bic(c: Criteria) -> float:
    return _likelihood(c) + c.d * float(np.log(c.N))


@dataclass(frozen=True)
class Criterion:
    """One criterion: its formula, how people write it, and what it says in one line.

    `squared` marks one that has the unit of y squared; the others are pure numbers. `beside` marks one that stands
    beside a model in a comparison and in a notebook; reports show all.
    """

    formula: Callable[[Criteria], float]
    label: str
    meaning: str
    squared: bool = False
    beside: bool = False


TABLE: dict[str, Criterion] = {
    "fpe": Criterion(_fpe, "FPE", "mean squared error to expect on new data of the same kind", True, beside=True),
    "aic": Criterion(_aic, "AIC", "likelihood with a penalty on d; compares models on one record, lower is better"),
    "aicc": Criterion(_aicc, "AICc", "AIC corrected for few samples", beside=True),
    "naic": Criterion(_naic, "nAIC", "AIC per sample, without its constant"),
    "bic": Criterion(_bic, "BIC", "as AIC, but its penalty grows with N: it prefers smaller models", beside=True),
}


def _own_means(y: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """The mean of the experiment of each sample (N,); about the first sample, so that a constant has no rest."""
    counts = np.maximum(np.bincount(numbers), 1)
    return y[0] + (np.bincount(numbers, y - y[0]) / counts)[numbers] if len(y) else y


def criteria(loss: float, N: int, d: int, mse: float | None = None) -> Criteria:
    """Criteria from the loss, the number of samples N and of parameters d; the default of mse is the loss."""
    return Criteria(loss, loss if mse is None else mse, N, d)


def fit_percent(y: np.ndarray, yhat: np.ndarray, experiment_numbers: np.ndarray | None = None) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean y||) of one output (N,); -inf where the model is not finite.

    The mean is that of the sample's own experiment, by its number (N,) from 0: a level that differs from log to log,
    which an initial state takes up, is nothing that a model explains. A constant y has no scale: the fit is then 100 if
    yhat equals it and -inf otherwise.
    """
    apart = y - (y.mean() if experiment_numbers is None else _own_means(y, experiment_numbers))
    # The squares of very small or large numbers are 0 or infinite; a power of two changes no other digit.
    unit = 2.0 ** np.floor(np.log2(np.abs(apart).max(initial=0.0) or 1.0))
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.linalg.norm((y - yhat) / unit))
    spread = float(np.linalg.norm(apart / unit))
    if not np.isfinite(error):
        return -np.inf
    if spread == 0.0:
        return 100.0 if error == 0.0 else -np.inf
    return 100.0 * (1.0 - error / spread)

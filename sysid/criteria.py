"""How good a fit is: fit %, loss, FPE, AIC, AICc, nAIC, BIC (Ljung, System Identification, 2nd ed., chapter 16)."""

from dataclasses import asdict, dataclass

import numpy as np


@dataclass(frozen=True)
class Criteria:
    """Criteria of one fit: N samples, d free parameters after the gauge, initial states counted.

    loss V = e'e / N, in the unit of y squared; mse is the same for one output without weights. A criterion that N does
    not allow (N <= d for FPE, N <= d + 1 for AICc) is infinite.
    """

    loss: float
    mse: float
    fpe: float
    aic: float
    aicc: float
    naic: float
    bic: float
    N: int
    d: int

    def as_dict(self) -> dict[str, float]:
        """All values by name."""
        return asdict(self)


def criteria(loss: float, N: int, d: int) -> Criteria:
    """Criteria from the loss V = e'e / N, the number of samples N and of parameters d."""
    log_loss = float(np.log(loss)) if loss > 0 else -np.inf
    aic = N * log_loss + 2 * d + N * (np.log(2 * np.pi) + 1)
    return Criteria(
        loss=loss,
        mse=loss,
        fpe=loss * (1 + d / N) / (1 - d / N) if d < N else np.inf,
        aic=aic,
        aicc=aic + 2 * d * (d + 1) / (N - d - 1) if d + 1 < N else np.inf,
        naic=log_loss + 2 * d / N,
        bic=N * log_loss + N * (np.log(2 * np.pi) + 1) + d * np.log(N),
        N=N,
        d=d,
    )


def fit_percent(y: np.ndarray, yhat: np.ndarray) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean y||) of one output (N,); -inf where the model is not finite.

    A constant y has no scale to compare with: the fit is then 100 where yhat equals it and -inf elsewhere.
    """
    error, spread = float(np.linalg.norm(y - yhat)), float(np.linalg.norm(y - y.mean()))
    if not np.isfinite(error):
        return -np.inf
    if spread == 0.0:
        return 100.0 if error == 0.0 else -np.inf
    return 100.0 * (1.0 - error / spread)

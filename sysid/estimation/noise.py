"""The residuals of a free run as an autoregression, and its forecast: what a chain predicts k samples ahead.

A chain has no noise model of its own: y = G u + v. With v(t) = a1 v(t-1) + ... + ap v(t-p) + white noise, the best
prediction from the outputs up to t-k is the free run plus the forecast of v (Ljung, System Identification, 2nd ed.
1999, section 3.2).
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

MOST = 16  # coefficients
_SHORTEST = 8  # samples for each coefficient
_ROUNDING = 1e-10  # of the output's size (rms): smaller residuals are no noise


def autoregression(v: np.ndarray, lengths: Sequence[int], size: float = 0.0) -> tuple[float, ...]:
    """Coefficients a1..ap of residuals v (N,) of several experiments, stable by construction (Yule-Walker).

    The order up to 16 is that of the least AIC; none for white noise, and for residuals that are rounding of an output
    of this `size` (rms).
    """
    ends = np.cumsum(lengths)
    pieces = [v[end - n : end] for n, end in zip(lengths, ends, strict=True)]
    most = min(MOST, len(v) // _SHORTEST, min(lengths) - 1)
    if not np.all(np.isfinite(v)) or np.sqrt(np.mean(v**2)) <= _ROUNDING * size or not np.any(v):
        return ()
    r = np.array([sum(float(p[k:] @ p[: len(p) - k]) for p in pieces) for k in range(most + 1)]) / len(v)
    best, least = np.empty(0), len(v) * np.log(r[0])
    for p in range(1, most + 1):
        a = solve_toeplitz(r[:p], r[1 : p + 1])
        variance = r[0] - float(a @ r[1 : p + 1])
        if variance <= 1e-12 * r[0]:
            break
        aic = len(v) * np.log(variance) + 2 * p
        if aic < least:
            best, least = a, aic
    return tuple(float(x) for x in best)


def forecast(v: np.ndarray, a: Sequence[float], horizon: int, seen: np.ndarray | None = None) -> np.ndarray:
    """v(t | t-horizon) (N,): each residual from those up to `horizon` samples before it, none before the record.

    A residual that was not `seen` (N,) is replaced by its own forecast.
    """
    p = len(a)
    if not p:
        return np.zeros_like(v)
    if seen is not None and not seen.all():
        v, c = v.copy(), np.array(a)
        for t in np.flatnonzero(~seen):
            past = v[max(t - p, 0) : t][::-1]
            v[t] = float(c[: len(past)] @ past)
    step = np.eye(p, k=-1)
    step[0] = np.array(a)
    weights = np.linalg.matrix_power(step, horizon)[0]
    late = np.concatenate([np.zeros(min(horizon, len(v))), v[: max(len(v) - horizon, 0)]])
    return np.asarray(lfilter(weights, [1.0], late))

"""Long-run covariance of a fit's scores: it makes a covariance robust to coloured residuals."""

from collections.abc import Sequence

import numpy as np

from sysid.base.errors import InputError
from sysid.uncertainty.noise_model import noise_model

_MEMORY = 0.97  # an autocorrelation above this is a drift, for which no bandwidth is sufficient


def long_run_covariance_root(
    e: np.ndarray, V: np.ndarray, lengths: Sequence[int], lags: int | str
) -> tuple[np.ndarray, int]:
    """Root R (r, r) with R R' = the covariance of V'e for residuals e (N,) and orthonormal V (N, r), and the lags used.

    lags: those of the Bartlett window over the scores e_t V_t (Newey and West 1987, Econometrica 55). 'auto' first
    whitens the residuals with an autoregression and gathers V accordingly, then takes Andrews' bandwidth for what
    is left (prewhitening: Andrews and Monahan 1992, Econometrica 60). The residuals are whitened instead of the scores
    because a few coefficients describe noise, and the scores of slow and of fast parameters have no common ones. The
    window covers what the coefficients leave: noise that varies in size, and errors that depend on the input.
    """
    if isinstance(lags, str):
        if lags != "auto":
            raise InputError(f"lags is {lags!r}; give 'auto', None or a whole number")
        noise = noise_model(e, V, lengths)
        G, before = noise.gathered(V, lengths)
        scores = noise.white(e, lengths)[:, None] * G
        m = _bandwidth(scores)
        rows = [_bartlett_root(scores, lengths, m).T, np.sqrt(noise.variance) * before]
        return np.asarray(np.linalg.qr(np.concatenate(rows), mode="r")).T, m
    if lags < 0 or int(lags) != lags or lags >= min(lengths):
        raise InputError(f"lags is {lags!r}; give 'auto', None or a whole number from 0 to {min(lengths) - 1}")
    return _bartlett_root(e[:, None] * V, lengths, int(lags)), int(lags)


def _bartlett_root(scores: np.ndarray, lengths: Sequence[int], lags: int) -> np.ndarray:
    """R R' = sum_k (1 - |k|/(lags + 1)) sum_t s_t s_{t-k}', for scores s (N, r) of several experiments.

    The triangular window equals the mean of the squared sums over all windows of lags + 1 samples: one pass over the
    samples, and positive semidefinite by construction.
    """
    m, sums, end = lags + 1, [], 0
    for n in lengths:
        total = np.concatenate([np.zeros((m, scores.shape[1])), np.cumsum(scores[end : end + n], axis=0)])
        total = np.concatenate([total, np.repeat(total[-1:], lags, axis=0)])
        sums.append(total[m:] - total[:-m])
        end += n
    R = np.asarray(np.linalg.qr(np.concatenate(sums), mode="r"))
    return R.T / np.sqrt(m)


def _lag_one(scores: np.ndarray) -> np.ndarray:
    size = np.sum(scores**2, axis=0)
    r = np.sum(scores[1:] * scores[:-1], axis=0) / np.where(size > 0, size, 1.0)
    return np.clip(r, -_MEMORY, _MEMORY)


def _bandwidth(scores: np.ndarray) -> int:
    """1.1447 (a N)^(1/3) with a = mean of 4 r^2 / (1 - r^2)^2 (Andrews 1991, Econometrica 59, equation 6.2)."""
    r = _lag_one(scores)
    a = float(np.mean(4.0 * r * r / (1.0 - r * r) ** 2))
    return min(int(np.ceil(1.1447 * (a * len(scores)) ** (1.0 / 3.0))), len(scores) // 4)

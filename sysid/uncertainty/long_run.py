"""Long-run covariance of scores: it makes a covariance robust to coloured residuals."""

from collections.abc import Sequence

import numpy as np

from sysid.base.errors import InputError

_MEMORY = 0.97  # an autocorrelation above this is a drift, for which no bandwidth is sufficient


def long_run_covariance_root(scores: np.ndarray, lengths: Sequence[int], lags: int | str) -> tuple[np.ndarray, int]:
    """Root R (r, r) with R R' = sum of all autocovariances of scores (N, r), and the lags used.

    lags: those of the Bartlett window (Newey and West 1987, Econometrica 55). 'auto' first whitens each score with a
    fitted AR(1) and then uses Andrews' bandwidth (Andrews and Monahan 1992, Econometrica 60), because a window long
    enough for slow noise would lose a tenth of the variance.
    """
    if isinstance(lags, str):
        if lags != "auto":
            raise InputError(f"lags is {lags!r}; give 'auto', None or a whole number")
        memory, white = _prewhitened(scores, lengths)
        m = _bandwidth(white)
        return _bartlett_root(white, lengths, m) / (1.0 - memory)[:, None], m
    if lags < 0 or int(lags) != lags or lags >= min(lengths):
        raise InputError(f"lags is {lags!r}; give 'auto', None or a whole number from 0 to {min(lengths) - 1}")
    return _bartlett_root(scores, lengths, int(lags)), int(lags)


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


def _prewhitened(scores: np.ndarray, lengths: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """AR(1) coefficient of each score (r,) and the residuals (N, r)."""
    memory, white, first = _lag_one(scores), scores.copy(), np.cumsum([0, *lengths[:-1]])
    follows = np.ones(len(scores), dtype=bool)
    follows[first] = False
    white[follows] -= memory * scores[np.flatnonzero(follows) - 1]
    return memory, white


def _lag_one(scores: np.ndarray) -> np.ndarray:
    size = np.sum(scores**2, axis=0)
    r = np.sum(scores[1:] * scores[:-1], axis=0) / np.where(size > 0, size, 1.0)
    return np.clip(r, -_MEMORY, _MEMORY)


def _bandwidth(scores: np.ndarray) -> int:
    """1.1447 (a N)^(1/3) with a = mean of 4 r^2 / (1 - r^2)^2 (Andrews 1991, Econometrica 59, equation 6.2)."""
    r = _lag_one(scores)
    a = float(np.mean(4.0 * r * r / (1.0 - r * r) ** 2))
    return min(int(np.ceil(1.1447 * (a * len(scores)) ** (1.0 / 3.0))), len(scores) // 4)

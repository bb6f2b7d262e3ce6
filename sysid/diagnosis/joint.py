"""Joint tests of further regressors: the directions they add to a regression, and how likely chance is there.

A test works in the space of the samples. Columns that are nearly combinations of others (lags of an input without power
at high frequencies) have no coefficients worth the name, but the directions that they add are orthonormal and the
projection of the errors on them is as well determined as any.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

_NEW = 1e-6  # part of a column that is left after the others, below which it adds nothing
_LEVERAGE = 0.5  # largest that counts: rows that determine their own value have no error to judge by


@dataclass(frozen=True)
class Directions:
    """Orthonormal directions U (M, k), the errors' projections s (k,) and p, how likely chance is; share of e'e."""

    U: np.ndarray
    s: np.ndarray
    p: float
    share: float


def span(X: np.ndarray) -> np.ndarray:
    """Orthonormal columns (M, r) that span X (M, n)."""
    U, s, _ = np.linalg.svd(X / _norm(X), full_matrices=False)
    return np.asarray(U[:, s > 1e-10 * s[0]])


def joint(Q: np.ndarray, extra: np.ndarray, e: np.ndarray) -> Directions:
    """Test of the columns `extra` (M, k) beyond the orthonormal Q (M, r), for the errors e (M,) without them."""
    extra = extra - extra.mean(axis=0)
    left = extra / _norm(extra)
    for _ in range(2):  # twice is enough (Kahan, in Parlett 1980)
        left = left - Q @ (Q.T @ left)
    U, size, _ = np.linalg.svd(left, full_matrices=False)
    U = U[:, size > _NEW]
    return Directions(U, U.T @ e, p_value(Q, U, e), float(np.sum((U.T @ e) ** 2)) / (float(e @ e) or 1.0))


def p_value(Q: np.ndarray, U: np.ndarray, e: np.ndarray) -> float:
    """Probability that chance alone gives U'e (k,) as large, for errors e after the orthonormal Q (M, r)."""
    if not U.shape[1] or not np.any(e):
        return 1.0
    s = U.T @ e
    return wald(s, meat(np.hstack([Q, U]), U, e - U @ s), len(e) - Q.shape[1] - U.shape[1])


def meat(Q: np.ndarray, U: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of U'e for errors `left` after the orthonormal Q (M, r), which holds U.

    Robust to errors whose size changes along the record (White 1980, in the form HC3 of MacKinnon and White 1985).
    """
    leverage = np.minimum(np.sum(Q**2, axis=1), _LEVERAGE)
    half = U * (left / (1.0 - leverage))[:, None]
    return np.asarray(half.T @ half)


def wald(s: np.ndarray, covariance: np.ndarray, freedom: int) -> float:
    """Probability that chance alone gives s (k,) of this covariance (k, k) as large (F)."""
    values, vectors = np.linalg.eigh(covariance)
    keep = values > 1e-8 * max(values[-1], 1e-300)
    m = int(keep.sum())
    if freedom < 1 or not m:
        return 1.0
    return float(fdtrc(m, freedom, float(np.sum((vectors[:, keep].T @ s) ** 2 / values[keep])) / m))


def _norm(X: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(X, axis=0)
    return np.asarray(np.where(norm > 0, norm, 1.0))

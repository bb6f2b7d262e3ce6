"""The colour of a fit's residuals: an autoregression, and what it makes of the covariance of least squares.

Noise that does not depend on the input gives least squares the covariance (J'J)^-1 J' S J (J'J)^-1, S being that of the
noise. A few coefficients tell S. A fit also takes out the slow part of the noise that its parameters can follow, so the
residuals look whiter than the noise; the restricted likelihood counts only what no parameter can follow (Cheang and
Reinsel 2000, J. Am. Stat. Assoc. 95; Harville 1977, J. Am. Stat. Assoc. 72).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter

_MOST = 8  # coefficients; noise of longer memory is a matter of the bandwidth
_BLOCK = 20_000  # rows whose lags are in memory at once
_STEADY = 0.995  # largest modulus of a root: beyond it noise is a drift
_RING = 1e-6  # what is left of the noise's memory where it is cut


@dataclass(frozen=True)
class NoiseModel:
    """w = A(q) e with A (p + 1,), A[0] = 1, and the variance of the white w."""

    A: np.ndarray
    variance: float

    def white(self, e: np.ndarray, lengths: Sequence[int]) -> np.ndarray:
        """w (N,) of each experiment in turn; the first p samples see fewer past ones."""
        return np.concatenate([lfilter(self.A, [1.0], piece) for piece in _pieces(e, lengths)])

    def gathered(self, V: np.ndarray, lengths: Sequence[int]) -> np.ndarray:
        """G (M, r) with V'e = G'w for V (N, r): what each sample of the white noise adds to V'e, later ones included.

        M exceeds N by the samples before each experiment that its noise still remembers.
        """
        found = []
        for piece in _pieces(V, lengths):
            ring = np.concatenate([piece[::-1], np.zeros((self.memory, V.shape[1]))])
            found.append(lfilter([1.0], self.A, ring, axis=0)[::-1])
        return np.concatenate(found)

    @property
    def memory(self) -> int:
        """Samples until the noise has forgotten."""
        r = float(np.abs(np.roots(self.A)).max(initial=0.0))
        return 0 if r == 0.0 else int(np.ceil(np.log(_RING) / np.log(min(r, _STEADY))))


def noise_model(e: np.ndarray, V: np.ndarray, lengths: Sequence[int]) -> NoiseModel:
    """The autoregression of residuals e (N,) of a fit whose Jacobian spans the orthonormal columns of V (N, r).

    The order is that of the least AIC (Akaike 1974), up to 8.
    """
    most = min(_MOST, min(lengths) // 20)
    gram, n = _gram(np.column_stack([e, V]), lengths, most)
    best = None
    for p in range(most + 1):
        a = np.zeros(p) if best is None else np.append(best[1], 0.0)
        if p:
            a = _steady(minimize(_restricted, a, (gram, n), method="BFGS").x)
        found = _restricted(a, gram, n) + 2.0 * p, a
        if best is not None and found[0] >= best[0]:
            if p > len(best[1]) + 1:
                break
            continue
        best = found
    assert best is not None
    A = np.concatenate([[1.0], best[1]])
    rest, _, r = _left(A, gram)
    return NoiseModel(A, rest / max(n - r, 1))


def _restricted(a: np.ndarray, gram: np.ndarray, n: int) -> float:
    """-2 log of the restricted likelihood of an autoregression, the variance at its best."""
    rest, logdet, r = _left(np.concatenate([[1.0], a]), gram)
    return (n - r) * float(np.log(rest)) + logdet if rest > 0 else np.inf


def _left(A: np.ndarray, gram: np.ndarray) -> tuple[float, float, int]:
    """Sum of squares of A e without what A V explains, log det V'A'A V, and the number of columns of V."""
    k = len(A)
    G = np.einsum("i,iajb,j->ab", A, gram[:k, :, :k], A)
    if len(G) == 1:
        return float(G[0, 0]), 0.0, 0
    try:
        L = np.linalg.cholesky(G[1:, 1:])
    except np.linalg.LinAlgError:
        return 0.0, 0.0, len(G) - 1
    along = np.linalg.solve(L, G[1:, 0])
    return float(G[0, 0] - along @ along), 2.0 * float(np.log(np.diag(L)).sum()), len(G) - 1


def _gram(x: np.ndarray, lengths: Sequence[int], most: int) -> tuple[np.ndarray, int]:
    """sum_t x_(t-i) x_(t-j)' (most + 1, c, most + 1, c) over all t with a past of `most`, and how many these are."""
    c = x.shape[1]
    total, n = np.zeros(((most + 1) * c, (most + 1) * c)), 0
    for piece in _pieces(x, lengths):
        for start in range(most, len(piece), _BLOCK):
            end = min(start + _BLOCK, len(piece))
            wide = np.hstack([piece[start - k : end - k] for k in range(most + 1)])
            total += wide.T @ wide
            n += end - start
    return total.reshape(most + 1, c, most + 1, c), n


def _steady(a: np.ndarray) -> np.ndarray:
    """The same with roots that are at most `_STEADY` in modulus."""
    roots = np.roots(np.concatenate([[1.0], a])).astype(complex)
    size = np.abs(roots)
    if not np.all(np.isfinite(a)) or not np.any(size > _STEADY):
        return np.where(np.isfinite(a), a, 0.0)
    roots = np.where(size > _STEADY, roots * (_STEADY / np.maximum(size, _STEADY)), roots)
    return np.real(np.poly(roots))[1:]


def _pieces(x: np.ndarray, lengths: Sequence[int]) -> list[np.ndarray]:
    return np.split(x, np.cumsum(lengths)[:-1])

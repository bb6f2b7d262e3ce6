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
_STEADY = 0.995  # largest partial autocorrelation: beyond it noise is a drift
_RING = 1e-6  # what is left of the noise's memory where it is cut


@dataclass(frozen=True)
class NoiseModel:
    """w = A(q) e with A (p + 1,), A[0] = 1, and the variance of the white w."""

    A: np.ndarray
    variance: float

    def white(self, e: np.ndarray, lengths: Sequence[int]) -> np.ndarray:
        """w (N,) of each experiment in turn; the first p samples see fewer past ones."""
        return np.concatenate([lfilter(self.A, [1.0], piece) for piece in _pieces(e, lengths)])

    def gathered(self, V: np.ndarray, lengths: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """G (N, r) and G0 (M, r) with V'e = G'w + G0'w0 for V (N, r), w0 being the white noise before each experiment.

        A row says what one sample of white noise adds to V'e, through the later samples that remember it.
        """
        found, before = [], []
        for piece in _pieces(V, lengths):
            back = np.concatenate([piece[::-1], np.zeros((self.memory, V.shape[1]))])
            G = lfilter([1.0], self.A, back, axis=0)[::-1]
            found.append(G[self.memory :])
            before.append(G[: self.memory])
        return np.concatenate(found), np.concatenate(before)

    def root(self, V: np.ndarray, lengths: Sequence[int]) -> np.ndarray:
        """R (r, r) with R R' the covariance of V'e."""
        R: np.ndarray = np.linalg.qr(np.concatenate(self.gathered(V, lengths)), mode="r")  # type: ignore[assignment]
        return np.sqrt(self.variance) * R.T

    @property
    def memory(self) -> int:
        """Samples until the noise has forgotten."""
        r = float(np.abs(np.roots(self.A)).max(initial=0.0))
        return 0 if r == 0.0 else int(np.ceil(np.log(_RING) / np.log(min(r, 0.9995))))


def noise_model(e: np.ndarray, V: np.ndarray, lengths: Sequence[int]) -> NoiseModel:
    """The autoregression of residuals e (N,) of a fit whose Jacobian spans the orthonormal columns of V (N, r).

    The order is that of the least AIC (Akaike 1974), up to 8.
    """
    most = min(_MOST, min(lengths) // 20)
    likelihood = _Restricted(_gram(np.column_stack([e, V]), lengths, most), sum(lengths), len(lengths))
    best, chosen, z = likelihood(np.zeros(0)), np.zeros(0), np.zeros(0)
    for p in range(1, most + 1):
        z = minimize(likelihood, np.append(z, 0.0), method="BFGS", options={"gtol": 1e-2, "maxiter": 30}).x
        found = likelihood(z) + 2.0 * p
        if found < best:
            best, chosen = found, z
        elif p > len(chosen) + 1:  # two orders in turn brought nothing
            break
    A = _coefficients(chosen)
    return NoiseModel(A, likelihood.left(A)[0] / max(sum(lengths) - V.shape[1], 1))


@dataclass(frozen=True)
class _Restricted:
    """-2 log of the restricted likelihood of an autoregression of n samples in `records` experiments.

    The variance is at its best. gram (p + 1, p + 1, c, c) is that of `_gram`.
    """

    gram: np.ndarray
    n: int
    records: int

    def __call__(self, z: np.ndarray) -> float:
        rest, logdet = self.left(_coefficients(z))
        if not rest > 0.0:
            return 1e9
        free = self.n - self.gram.shape[2] + 1
        noise = -np.sum(np.arange(1, len(z) + 1) * np.log1p(-((_STEADY * np.tanh(z)) ** 2)))  # log det of its matrix
        return free * float(np.log(rest)) + logdet + self.records * float(noise)

    def left(self, A: np.ndarray) -> tuple[float, float]:
        """e'S^-1 e without what V explains, and log det V'S^-1 V, for noise of variance 1 with the matrix S."""
        k = len(A)
        G = np.einsum("i,ijab,j->ab", A, self.gram[:k, :k], A)
        if len(G) == 1:
            return float(G[0, 0]), 0.0
        try:
            L = np.linalg.cholesky(G[1:, 1:])
        except np.linalg.LinAlgError:
            return 0.0, 0.0
        along = np.linalg.solve(L, G[1:, 0])
        return float(G[0, 0] - along @ along), 2.0 * float(np.log(np.diag(L)).sum())


def _coefficients(z: np.ndarray) -> np.ndarray:
    """A (p + 1,) from z (p,), the inverse hyperbolic tangents of the partial autocorrelations: always stationary.

    The Levinson-Durbin recursion; Barndorff-Nielsen and Schou 1973, J. Multivariate Analysis 3.
    """
    A = np.ones(1)
    for r in _STEADY * np.tanh(z):
        A = np.append(A, 0.0) - r * np.append(0.0, A[::-1])
    return A


def _gram(x: np.ndarray, lengths: Sequence[int], most: int) -> np.ndarray:
    """D (p + 1, p + 1, c, c) of x (N, c) with x'S^-1 x = sum_ij A_i A_j D_ij, exact from the first sample on.

    D_ij = sum of x_(t+i) x_(t+j)' over t = 0 .. N - 1 - i - j (Box, Jenkins and Reinsel, Time Series Analysis, 3rd ed.
    1994, appendix A7.5); p = `most`.
    """
    c = x.shape[1]
    D = np.zeros((most + 1, most + 1, c, c))
    for piece in _pieces(x, lengths):
        n = len(piece)
        for j in range(most + 1):
            own = piece[: n - j].T @ piece[j:]
            for i in range(most + 1 - j):
                D[i, i + j] += own
                if j:
                    D[i + j, i] += own.T
                first, last = np.outer(piece[i], piece[i + j]), np.outer(piece[n - 1 - i - j], piece[n - 1 - i])
                own = own - first - last
    return D


def _pieces(x: np.ndarray, lengths: Sequence[int]) -> list[np.ndarray]:
    return np.split(x, np.cumsum(lengths)[:-1])

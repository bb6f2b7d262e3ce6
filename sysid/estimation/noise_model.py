"""The colour of a fit's residuals: an autoregression, and what it makes of the covariance of least squares.

Noise that does not depend on the input gives least squares the covariance (J'J)^-1 J' S J (J'J)^-1, S being that of the
noise. A few coefficients tell S. A fit also takes out the slow part of the noise that its parameters can follow, so the
residuals look whiter than the noise; the restricted likelihood counts only what no parameter can follow (Cheang and
Reinsel 2000, J. Am. Stat. Assoc. 95; Harville 1977, J. Am. Stat. Assoc. 72). The long-run covariance of a fit's scores
makes a covariance robust to coloured residuals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, root
from scipy.signal import lfilter

from sysid.base.errors import InputError

_LARGEST_ORDER = 8  # coefficients; noise of longer memory is a matter of the bandwidth
_LARGEST_PARTIAL = 0.995  # largest partial autocorrelation: beyond it noise is a drift
_FORGOTTEN = 1e-6  # what is left of the noise's memory where it is cut
_LARGEST_AUTOCORRELATION = 0.97  # an autocorrelation above this is a drift, for which no bandwidth is sufficient
_DEPENDENT = 1e-9  # singular values of a Jacobian below this share of the largest are rounding


@dataclass(frozen=True)
class NoiseModel:
    """w = A(q) e with A (p + 1,), A[0] = 1, and the variance of the white w."""

    A: np.ndarray
    variance: float

    def white(self, e: np.ndarray, lengths: Sequence[int]) -> np.ndarray:
        """w of e (N,) or (N, n), of each experiment in turn; the first p samples see fewer past ones."""
        return np.concatenate([lfilter(self.A, [1.0], piece, axis=0) for piece in _pieces(e, lengths)])

    def gathered(self, V: np.ndarray, lengths: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """G (N, r) and G0 (M, r) with V'e = G'w + G0'w0 for V (N, r), w0 being the white noise before each experiment.

        A row says what one sample of white noise adds to V'e, through the later samples that remember it.
        """
        rows, initial_rows = [], []
        for piece in _pieces(V, lengths):
            reversed_rows = np.concatenate([piece[::-1], np.zeros((self.memory, V.shape[1]))])
            G = lfilter([1.0], self.A, reversed_rows, axis=0)[::-1]
            rows.append(G[self.memory :])
            initial_rows.append(G[: self.memory])
        return np.concatenate(rows), np.concatenate(initial_rows)

    def level(self, V: np.ndarray, lengths: Sequence[int]) -> float:
        """The variance of white noise that gives V'e of V (N, r) the variance that this noise gives it."""
        largest = float(np.abs(V).max(initial=0.0))
        if largest == 0.0:
            return self.variance  # no noise comes through
        V = V / largest  # whose squares may be too small for numbers
        size = sum(float(np.sum(rows**2)) for rows in self.gathered(V, lengths))
        return self.variance * size / float(np.sum(V**2))

    def root(self, V: np.ndarray, lengths: Sequence[int]) -> np.ndarray:
        """R (r, r) with R R' the covariance of V'e."""
        R: np.ndarray = np.linalg.qr(np.concatenate(self.gathered(V, lengths)), mode="r")  # type: ignore[assignment]
        return np.sqrt(self.variance) * R.T

    @property
    def memory(self) -> int:
        """Samples until the noise has forgotten."""
        r = float(np.abs(np.roots(self.A)).max(initial=0.0))
        return 0 if r == 0.0 else int(np.ceil(np.log(_FORGOTTEN) / np.log(min(r, 0.9995))))


def noise_model(e: np.ndarray, J: np.ndarray, lengths: Sequence[int]) -> NoiseModel:
    """The autoregression of residuals e (N,) of a fit with the Jacobian J (N, n), whose columns may be dependent.

    The order is that of the least AIC (Akaike 1974), up to 8.
    """
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    V = U[:, s > _DEPENDENT * s.max(initial=0.0)]
    highest_order = min(_LARGEST_ORDER, min(*lengths, len(e) - V.shape[1]) // 20)
    likelihood = _RestrictedLikelihood(
        _gram(np.column_stack([e, V]), lengths, highest_order), sum(lengths), len(lengths)
    )
    n = sum(lengths)
    best, best_r, r = likelihood(np.zeros(0))[0], np.zeros(0), np.zeros(0)
    for p in range(1, highest_order + 1):
        limits = [(-_LARGEST_PARTIAL, _LARGEST_PARTIAL)] * p
        end = minimize(likelihood, np.append(r, 0.0), jac=True, bounds=limits, options={"ftol": 0.0, "gtol": 1e-6})
        r, criterion = end.x, end.fun + 2.0 * p / n
        if criterion < best:
            best, best_r = criterion, r
        elif p > len(best_r) + 1:  # two orders in turn brought nothing
            break
    A = _coefficients(_polished(likelihood, best_r))[0]
    return NoiseModel(A, likelihood.left(A)[0] / max(sum(lengths) - V.shape[1], 1))


def _polished(likelihood: "_RestrictedLikelihood", r: np.ndarray) -> np.ndarray:
    """r (p,) where the gradient is zero: the values round off long before, and their last digits would decide."""
    free = np.abs(r) < _LARGEST_PARTIAL

    def full(values: np.ndarray) -> np.ndarray:
        out = r.copy()
        out[free] = np.clip(values, -_LARGEST_PARTIAL, _LARGEST_PARTIAL)
        return out

    return full(root(lambda values: likelihood(full(values))[1][free], r[free], tol=1e-14).x) if free.any() else r


@dataclass(frozen=True)
class _RestrictedLikelihood:
    """-2/n log of the restricted likelihood of an autoregression of n samples in `records` experiments.

    The variance is at its best. gram (p + 1, p + 1, c, c) is that of `_gram`.
    """

    gram: np.ndarray
    n: int
    records: int

    def __call__(self, r: np.ndarray) -> tuple[float, np.ndarray]:
        """Its value and its gradient (p,) at the partial autocorrelations r (p,)."""
        A, dA = _coefficients(r)
        rest, logdet, by_rest, by_logdet = self.left(A)
        if not rest > 0.0:
            return 1e9, np.zeros(len(r))
        free = self.n - self.gram.shape[2] + 1
        order = np.arange(1, len(r) + 1)
        noise = -np.sum(order * np.log1p(-(r**2)))  # log det of the noise's matrix
        by_noise = 2.0 * order * r / (1.0 - r**2)
        value = free * float(np.log(rest)) + logdet + self.records * float(noise)
        gradient = (free / rest * by_rest + by_logdet) @ dA + self.records * by_noise
        return value / self.n, gradient / self.n

    def left(self, A: np.ndarray) -> tuple[float, float, np.ndarray, np.ndarray]:
        """e'S^-1 e without what V explains, log det V'S^-1 V, and the gradients (p + 1,) of both by A.

        S is the matrix of noise of variance 1.
        """
        k = len(A)
        half = np.tensordot(A, self.gram[:k, :k], 1)
        G = np.tensordot(A, half, 1)
        dG = half + half.transpose(0, 2, 1)
        try:
            L = np.linalg.cholesky(G[1:, 1:])
        except np.linalg.LinAlgError:
            return 0.0, 0.0, np.zeros(k), np.zeros(k)
        inverse = np.linalg.inv(L)
        contrast = np.append(1.0, -inverse.T @ (inverse @ G[1:, 0]))  # e without what V explains, of [e, V]
        by_logdet = np.tensordot(dG[:, 1:, 1:], inverse.T @ inverse, 2)
        logdet = 2.0 * float(np.log(np.diag(L)).sum())
        return float(contrast @ G @ contrast), logdet, contrast @ dG @ contrast, by_logdet


def _coefficients(partial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (p + 1,) of partial autocorrelations (p,), and dA/dr (p + 1, p): stationary where they are between -1 and 1.

    The Levinson-Durbin recursion; Barndorff-Nielsen and Schou 1973, J. Multivariate Analysis 3.
    """
    A, dA = np.ones(1), np.zeros((1, 0))
    for r in partial:
        turned, zero = np.append(0.0, A[::-1]), np.zeros((1, dA.shape[1]))
        dA = np.column_stack([np.vstack([dA, zero]) - r * np.vstack([zero, dA[::-1]]), -turned])
        A = np.append(A, 0.0) - r * turned
    return A, dA


def _gram(x: np.ndarray, lengths: Sequence[int], highest_order: int) -> np.ndarray:
    """D (p + 1, p + 1, c, c) of x (N, c) with x'S^-1 x = sum_ij A_i A_j D_ij, exact from the first sample on.

    D_ij = sum of x_(t+i) x_(t+j)' over t = 0 .. N - 1 - i - j (Box, Jenkins and Reinsel, Time Series Analysis, 3rd ed.
    1994, appendix A7.5); p = `highest_order`.
    """
    c = x.shape[1]
    D = np.zeros((highest_order + 1, highest_order + 1, c, c))
    for piece in _pieces(x, lengths):
        n = len(piece)
        for j in range(highest_order + 1):
            products = piece[: n - j].T @ piece[j:]
            for i in range(highest_order + 1 - j):
                D[i, i + j] += products
                if j:
                    D[i + j, i] += products.T
                first, last = np.outer(piece[i], piece[i + j]), np.outer(piece[n - 1 - i - j], piece[n - 1 - i])
                products = products - first - last
    return D


def _pieces(x: np.ndarray, lengths: Sequence[int]) -> list[np.ndarray]:
    return np.split(x, np.cumsum(lengths)[:-1])


def long_run_covariance_root(
    e: np.ndarray, V: np.ndarray, lengths: Sequence[int], lags: int | str, noise: NoiseModel | None = None
) -> tuple[np.ndarray, int]:
    """Root R (r, r) with R R' = the covariance of V'e for residuals e (N,) and orthonormal V (N, r), and the lags used.

    lags: those of the Bartlett window over the scores e_t V_t (Newey and West 1987, Econometrica 55). 'auto' first
    whitens the residuals with an autoregression and gathers V accordingly, then takes Andrews' bandwidth for what
    is left (prewhitening: Andrews and Monahan 1992, Econometrica 60). The residuals are whitened instead of the scores
    because a few coefficients describe noise, and the scores of slow and of fast parameters have no common ones. The
    window covers what the coefficients leave: noise that varies in size, and errors that depend on the input. `noise`
    is this autoregression where it is known.
    """
    if isinstance(lags, str):
        if lags != "auto":
            raise InputError(f"lags is {lags!r}; give 'auto', None or a whole number")
        noise = noise or noise_model(e, V, lengths)
        G, initial_scores = noise.gathered(V, lengths)
        w = noise.white(e, lengths)
        scores = w[:, None] * G
        m = _bandwidth(scores)
        rows = [_bartlett_root(scores, lengths, m).T, np.sqrt(noise.variance) * initial_scores]
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
    return np.clip(r, -_LARGEST_AUTOCORRELATION, _LARGEST_AUTOCORRELATION)


def _bandwidth(scores: np.ndarray) -> int:
    """1.1447 (a N)^(1/3) with a = mean of 4 r^2 / (1 - r^2)^2 (Andrews 1991, Econometrica 59, equation 6.2)."""
    r = _lag_one(scores)
    a = float(np.sum(4.0 * r * r / (1.0 - r * r) ** 2)) / max(len(r), 1)  # no score where nothing is determined
    return min(int(np.ceil(1.1447 * (a * len(scores)) ** (1.0 / 3.0))), len(scores) // 4)

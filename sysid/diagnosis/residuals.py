"""Residual tests: are the errors white, and independent of the input?"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.special import bdtr, chdtrc, ndtri

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import json_value
from sysid.base.handlers import Shown

POOR = 80.0  # [%] of fit; below it a free run that leaves more than noise should be tried again
_SMALLEST = 1e-12  # p-value that is told


@dataclass(frozen=True, repr=False)
class ResidualTests(Shown):
    """Correlations of the residuals e with themselves (lags 0..L) and with the input (lags -L..L), with their bounds.

    Whiteness: |r_e(k)| <= z / sqrt(N) for lags 1..L. Independence: |r_eu(k)| within z sqrt(sum R_e R_u / N), in the
    same scale (Ljung, System Identification, section 16.6). At level p, a share 1 - p of the lags is outside by chance.
    With a coloured input neighbouring lags leave the bound together, so the verdict is a joint test after whitening
    (Haugh, Journal of the American Statistical Association 71, 1976): `independence_p` is how likely chance is.
    """

    lags: np.ndarray
    autocorrelation: np.ndarray
    whiteness_bound: float
    cross_lags: np.ndarray
    cross_correlation: np.ndarray
    independence_bound: float
    level: float
    independence_p: float

    @property
    def whiteness_outside(self) -> int:
        """Number of lags above 0 outside the bound."""
        return int(np.sum(np.abs(self.autocorrelation[1:]) > self.whiteness_bound))

    @property
    def independence_outside(self) -> int:
        """Number of lags of the cross-correlation outside the bound."""
        return int(np.sum(np.abs(self.cross_correlation) > self.independence_bound))

    @property
    def white(self) -> bool:
        """True if chance explains every lag outside the bound (see `chance`)."""
        return chance(self.autocorrelation[1:], self.whiteness_bound, self.level)

    @property
    def independent(self) -> bool:
        """True if chance explains all lags together."""
        return self.independence_p >= 1.0 - self.level

    @property
    def verdicts(self) -> tuple[str, str]:
        """Both verdicts in words: on the residuals with themselves, and with the input by all lags together."""
        p = f"p = {self.independence_p:.2g}" if self.independence_p >= _SMALLEST else f"p < {_SMALLEST:g}"
        independent = "independent" if self.independent else "not independent"
        return "white" if self.white else "coloured", f"all lags together: {independent} ({p})"

    def as_dict(self) -> dict[str, Any]:
        """Numbers and verdicts, ready for JSON."""
        names = ("whiteness_outside", "independence_outside", "white", "independent")
        return json_value({**asdict(self), **{n: getattr(self, n) for n in names}})


def chance(r: np.ndarray, bound: float, level: float) -> bool:
    """Whether chance explains correlations r (n,) whose single-lag bound of this level is `bound`.

    True if at most as many lags are outside as one record in a hundred shows by chance, and none is outside the bound
    widened for all n lags together (Bonferroni).
    """
    n = len(r)
    widened = bound * float(ndtri(1.0 - (1.0 - level) / (2 * n)) / ndtri(0.5 + level / 2))
    outside = int(np.sum(np.abs(r) > bound))
    return bool(outside <= _allowed(n, level) and np.all(np.abs(r) <= widened))


def _allowed(n: int, level: float) -> int:
    """Smallest k with P(at most k of n lags outside) >= 0.99."""
    counts = np.arange(n + 1)
    return int(np.argmax(bdtr(counts, n, 1.0 - level) >= 0.99))


def poor(percent: float, tests: "ResidualTests | None") -> bool:
    """Whether a free run with this fit [%] misses its data by more than noise explains.

    A fit below POOR is poor, unless its residuals are white and independent of the input: then noise limits the fit.
    """
    return not percent >= POOR and not (tests is not None and tests.white and tests.independent)


@checked
def residual_tests(e: np.ndarray, u: np.ndarray, max_lag: int = 25, level: float = 0.99) -> ResidualTests:
    """Tests on residuals e (N,) for the input u (N,); raises InputError if N does not exceed 2 max_lag.

    A residual of zero everywhere (an exact model) passes both tests.
    """
    e, u = np.asarray(e, dtype=float).ravel(), np.asarray(u, dtype=float).ravel()
    N = len(e)
    if len(u) != N:
        raise InputError(f"residuals have {N} samples and the input {len(u)}; give both the same length")
    if 2 * max_lag >= N:
        raise InputError(f"{N} residuals are too few for lags up to {max_lag}; give more than {2 * max_lag}")
    e, u = e - e.mean(), u - u.mean()
    Re, Ru = _covariance(e, e, max_lag), _covariance(u, u, max_lag)
    scale_e, scale_u = Re[max_lag] or 1.0, Ru[max_lag] or 1.0
    z = float(ndtri(0.5 + level / 2.0))
    both = np.sqrt(scale_e * scale_u)
    # Products of covariances are a covariance too, so Bartlett's weights leave no negative sum.
    wide = min(max(max_lag, int(2 * np.sqrt(N))), N - 1)
    bartlett = 1.0 - np.abs(np.arange(-wide, wide + 1)) / (wide + 1)
    spread = float(np.sum(bartlett * _covariance(e, e, wide) * _covariance(u, u, wide)))
    return ResidualTests(
        lags=np.arange(max_lag + 1),
        autocorrelation=Re[max_lag:] / scale_e,
        whiteness_bound=z / np.sqrt(N),
        cross_lags=np.arange(-max_lag, max_lag + 1),
        cross_correlation=_covariance(e, u, max_lag) / both,
        independence_bound=z * float(np.sqrt(max(spread, 0.0) / N)) / both,
        level=level,
        independence_p=_independence(e, u, max_lag),
    )


def _independence(e: np.ndarray, u: np.ndarray, max_lag: int) -> float:
    """Probability that chance gives correlations of e and u, both whitened, as large at lags -max_lag..max_lag."""
    e, u = _whitened(e), _whitened(u)
    N = min(len(e), len(u))
    e, u = e[-N:], u[-N:]
    if not (np.any(e) and np.any(u)):
        return 1.0
    max_lag = min(max_lag, (N - 1) // 3)  # twice as many lags of the input are needed
    r = _covariance(e, u, max_lag) * np.sqrt(N / (N - np.abs(np.arange(-max_lag, max_lag + 1))))
    # Of white e the correlations at lags k and l have the covariance R_e(0) R_u(k - l) / N.
    values, vectors = np.linalg.eigh(toeplitz(_covariance(u, u, 2 * max_lag)[2 * max_lag :]))
    keep = values > 1e-3 * values[-1]
    square = np.sum((vectors[:, keep].T @ r) ** 2 / values[keep]) * N / float(np.mean(e**2))
    return float(chdtrc(int(keep.sum()), square))


def _whitened(x: np.ndarray) -> np.ndarray:
    """x (N,) behind the filter that its own autoregression gives (Yule and Walker), without the first samples.

    A thousandth of its variance counts as white noise, so that a signal that its past determines keeps its scale.
    """
    m = min(20, len(x) // 20)
    R = _covariance(x, x, m)[m:]
    if not m or R[0] == 0.0:
        return x
    c = solve_toeplitz(np.r_[1.001 * R[0], R[1:-1]], R[1:])
    return np.convolve(x, np.r_[1.0, -c])[m : len(x)]


def _covariance(a: np.ndarray, b: np.ndarray, max_lag: int) -> np.ndarray:
    """1/N sum_t a_t b_{t-k} for k = -max_lag..max_lag (2 max_lag + 1,)."""
    N = len(a)
    positive = [a[k:] @ b[: N - k] for k in range(max_lag + 1)]
    negative = [a[: N - k] @ b[k:] for k in range(max_lag, 0, -1)]
    return np.array(negative + positive) / N

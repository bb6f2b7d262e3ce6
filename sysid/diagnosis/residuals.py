"""Residual tests: are the errors white, independent of the input, and free of a nonlinearity that was missed?

Billings and Voon (1986, International Journal of Control 44) show that residuals of a nonlinear system may be white
and uncorrelated with the input although an even nonlinearity is missing. The correlations of e with u^2, of e^2 with
u^2 and of e with e u (`higher_order_tests`) detect it.
"""

from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.special import bdtr, chdtrc, ndtri

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import json_value
from sysid.base.handlers import Shown
from sysid.base.quantities import probability

POOR = 80.0  # [%] of fit; below it a free run that leaves more than noise should be tried again
CLOSE = 0.5  # points of fit: what is less counts as nothing
UNTESTED = "no residual tests: "  # a note that begins so gives the reason
MEANINGS = {
    "e with u^2": "an even nonlinearity of the input is missing",
    "e^2 with u^2": "the size of the error depends on the size of the input: a map or a noise level is missing",
    "e with e u": "noise and input multiply: the model lacks a cross term, or the noise does not enter at the output",
}


class Left(Protocol):
    """What tests say of the errors that a fit leaves."""

    @property
    def white(self) -> bool:
        """Whether they are like noise."""

    @property
    def independent(self) -> bool:
        """Whether the input explains none of them."""


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
    def rule(self) -> str:
        """When residuals are white, in a sentence."""
        n = len(self.lags) - 1
        return (
            f"Chance puts {100 * (1 - self.level):g} % of the lags of noise outside the {100 * self.level:g} % bound: "
            f"residuals are white with at most {_allowed_count(n, self.level)} of {n} lags outside, and none beyond "
            f"{_wider(n, self.level):.2f} times the bound. With the input, all lags count together."
        )

    @property
    def independent(self) -> bool:
        """True if chance explains all lags together."""
        return self.independence_p >= 1.0 - self.level

    @property
    def verdicts(self) -> tuple[str, str]:
        """Both verdicts in words: on the residuals with themselves, and with the input by all lags together."""
        independent = "independent" if self.independent else "not independent"
        return (
            "white" if self.white else "coloured",
            f"all lags together: {independent} ({probability(self.independence_p)})",
        )

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
    count = int(np.sum(np.abs(r) > bound))
    return bool(count <= _allowed_count(n, level) and np.all(np.abs(r) <= bound * _wider(n, level)))


def _wider(n: int, level: float) -> float:
    """How many times the bound of one lag is that of n lags together."""
    return float(ndtri(1.0 - (1.0 - level) / (2 * n)) / ndtri(0.5 + level / 2))


def _allowed_count(n: int, level: float) -> int:
    """Smallest k with P(at most k of n lags outside) >= 0.99."""
    counts = np.arange(n + 1)
    return int(np.argmax(bdtr(counts, n, 1.0 - level) >= 0.99))


def poor(percent: float, tests: Left | None) -> bool:
    """Whether a free run with this fit [%] misses its data by more than noise explains.

    A fit below POOR is poor, unless its residuals are white and independent of the input: then noise limits the fit.
    One of 0 or less explains nothing, whatever the residuals look like: they are the output itself.
    """
    is_limited = percent > 0.0 and tests is not None and tests.white and tests.independent
    return not percent >= POOR and not is_limited


@checked
def residual_tests(
    e: np.ndarray, u: np.ndarray, max_lag: int = 25, level: float = 0.99, past: bool = False
) -> ResidualTests:
    """Tests on residuals e (N,) for the input u (N,); raises InputError if N does not exceed 2 max_lag.

    `past`: only earlier inputs are tested, because later ones may come from e by feedback (one step ahead). A residual
    of zero everywhere (an exact model) passes both tests.
    """
    e, u = np.asarray(e, dtype=float).ravel(), np.asarray(u, dtype=float).ravel()
    N = len(e)
    if len(u) != N:
        raise InputError(f"residuals have {N} samples and the input {len(u)}; give both the same length")
    if 2 * max_lag >= N:
        raise InputError(f"{N} residuals are too few for lags up to {max_lag}; give more than {2 * max_lag}")
    e, u = _of_size_one(e - e.mean()), _of_size_one(u - u.mean())
    Re, Ru = _covariance(e, e, max_lag), _covariance(u, u, max_lag)
    scale_e, scale_u = Re[max_lag] or 1.0, Ru[max_lag] or 1.0
    z = float(ndtri(0.5 + level / 2.0))
    scale = np.sqrt(scale_e * scale_u)
    # Products of covariances are a covariance too, so Bartlett's weights leave no negative sum.
    wide = min(max(max_lag, int(2 * np.sqrt(N))), N - 1)
    bartlett = 1.0 - np.abs(np.arange(-wide, wide + 1)) / (wide + 1)
    spread = float(np.sum(bartlett * _covariance(e, e, wide) * _covariance(u, u, wide)))
    tested = slice(max_lag + 1 if past else 0, None)
    return ResidualTests(
        lags=np.arange(max_lag + 1),
        autocorrelation=Re[max_lag:] / scale_e,
        whiteness_bound=z / np.sqrt(N),
        cross_lags=np.arange(-max_lag, max_lag + 1)[tested],
        cross_correlation=_covariance(e, u, max_lag)[tested] / scale,
        independence_bound=z * float(np.sqrt(max(spread, 0.0) / N)) / scale,
        level=level,
        independence_p=_independence_p_value(e, u, max_lag, past),
    )


def _of_size_one(x: np.ndarray) -> np.ndarray:
    """x by a power of two, which changes no digit, so that no fourth power of it overflows."""
    return np.ldexp(x, -int(np.frexp(np.abs(x).max(initial=0.0))[1]))


def _independence_p_value(e: np.ndarray, u: np.ndarray, max_lag: int, past: bool) -> float:
    """Probability that chance gives correlations of e and u, both whitened, as large at lags -max_lag..max_lag.

    At lags 1..max_lag where `past`.
    """
    e, u = _whiten(e), _whiten(u)
    N = min(len(e), len(u))
    e, u = e[-N:], u[-N:]
    if not (np.any(e) and np.any(u)):
        return 1.0
    max_lag = min(max_lag, (N - 1) // 3)  # twice as many lags of the input are needed
    lags = np.arange(1 if past else -max_lag, max_lag + 1)
    r = _covariance(e, u, max_lag)[-len(lags) :] * np.sqrt(N / (N - np.abs(lags)))
    # Of white e the correlations at lags k and l have the covariance R_e(0) R_u(k - l) / N.
    values, vectors = np.linalg.eigh(toeplitz(_covariance(u, u, 2 * max_lag)[2 * max_lag :][: len(lags)]))
    keep = values > 1e-3 * values[-1]
    square = np.sum((vectors[:, keep].T @ r) ** 2 / values[keep]) * N / float(np.mean(e**2))
    return float(chdtrc(int(keep.sum()), square))


def _whiten(x: np.ndarray) -> np.ndarray:
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


@dataclass(frozen=True)
class CrossTest:
    """One normalised correlation r(k) = sum_t a_t b_{t-k} / (N s_a s_b) over its lags, with the bound of one lag."""

    name: str
    meaning: str
    lags: np.ndarray
    correlation: np.ndarray
    bound: float
    level: float

    @property
    def outside(self) -> int:
        """Number of lags outside the bound."""
        return int(np.sum(np.abs(self.correlation) > self.bound))

    @property
    def passed(self) -> bool:
        """True unless a lag leaves the bound that is widened for all lags together (Bonferroni).

        The number of lags outside is not used: u^2 of a held input is correlated over many samples, so lags leave the
        bound in groups.
        """
        n = len(self.correlation)
        joint_bound = self.bound * float(ndtri(1.0 - (1.0 - self.level) / (2 * n)) / ndtri(0.5 + self.level / 2))
        return bool(np.all(np.abs(self.correlation) <= joint_bound))


@dataclass(frozen=True)
class HigherOrderTests:
    """The three tests; `advice` says what a failed test indicates."""

    tests: tuple[CrossTest, ...]
    level: float

    @property
    def passed(self) -> bool:
        """True where all tests pass."""
        return all(t.passed for t in self.tests)

    @property
    def advice(self) -> tuple[str, ...]:
        """One sentence for each failed test, with its number."""
        return tuple(
            f"{t.name}: |r| reaches {np.abs(t.correlation).max():.3f}, the {100 * t.level:g} % bound of one lag is "
            f"{t.bound:.3f}; {t.meaning}"
            for t in self.tests
            if not t.passed
        )

    def as_dict(self) -> dict[str, Any]:
        """Numbers and verdicts, ready for JSON."""
        rows = [
            {
                "name": t.name,
                "lags": t.lags,
                "correlation": t.correlation,
                "bound": t.bound,
                "outside": t.outside,
                "passed": t.passed,
            }
            for t in self.tests
        ]
        return json_value({"level": self.level, "passed": self.passed, "tests": rows, "advice": self.advice})


@checked
def higher_order_tests(e: np.ndarray, u: np.ndarray, max_lag: int = 25, level: float = 0.99) -> HigherOrderTests:
    """The tests on residuals e (N,) for the input u (N,), e later than u by lags 0..max_lag.

    Run the plain whiteness test first: the bounds are inaccurate if the residuals are far from white. Raises
    InputError if N does not exceed 2 max_lag. A residual of zero, or an input with two levels (its square is
    constant), passes.
    """
    e, u = np.asarray(e, dtype=float).ravel(), np.asarray(u, dtype=float).ravel()
    if len(u) != len(e):
        raise InputError(f"residuals have {len(e)} samples and the input {len(u)}; give both the same length")
    if max_lag < 0 or 2 * max_lag >= len(e):
        raise InputError(f"{len(e)} residuals are too few for lags up to {max_lag}; give more than {2 * max_lag}")
    # Correlations have no unit, and fourth powers of signals in an odd one leave the range of a number.
    e, u = (v / 2.0 ** np.floor(np.log2(np.abs(v).max() or 1.0)) for v in (e - e.mean(), u - u.mean()))
    # e_t against e_{t-1-k} u_{t-1-k}: the product is taken one sample earlier, so that white e gives 0 at every lag.
    product = np.concatenate([[0.0], (e * u)[:-1]])
    pairs = {"e with u^2": (e, u**2), "e^2 with u^2": (e**2, u**2), "e with e u": (e, product)}
    tests = tuple(_cross_test(name, a, b, max_lag, level) for name, (a, b) in pairs.items())
    return HigherOrderTests(tests, level)


def _cross_test(name: str, a: np.ndarray, b: np.ndarray, max_lag: int, level: float) -> CrossTest:
    """Correlation of a (N,) with earlier b (N,); the bound is Bartlett's, from both autocorrelations."""
    N, a, b = len(a), a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    lags = np.arange(max_lag + 1)
    if scale <= 1e-12 * N * max(float(np.mean(np.abs(a))), 1e-300) * max(float(np.mean(np.abs(b))), 1e-300):
        return CrossTest(name, MEANINGS[name], lags, np.zeros(len(lags)), np.inf, level)
    r = np.array([a[k:] @ b[: N - k] for k in lags]) / scale
    ra, rb = (np.array([x[k:] @ x[: N - k] for k in lags]) / (x @ x) for x in (a, b))
    spread = float(1.0 + 2.0 * np.sum(ra[1:] * rb[1:]))
    z = float(ndtri(0.5 + level / 2.0))
    return CrossTest(name, MEANINGS[name], lags, r, z * float(np.sqrt(max(spread, 0.1) / N)), level)

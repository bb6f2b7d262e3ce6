"""Higher-order residual tests: they detect a missing nonlinearity that linear correlations do not show.

Billings and Voon (1986, International Journal of Control 44) show that residuals of a nonlinear system may be white
and uncorrelated with the input although an even nonlinearity is missing. The correlations of e with u^2, of e^2 with
u^2 and of e with e u detect it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import json_value

NAMES = {
    "e with u^2": "an even nonlinearity of the input is missing",
    "e^2 with u^2": "the size of the error depends on the size of the input: a map or a noise level is missing",
    "e with e u": "noise and input multiply: the model lacks a cross term, or the noise does not enter at the output",
}


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
        widened = self.bound * float(ndtri(1.0 - (1.0 - self.level) / (2 * n)) / ndtri(0.5 + self.level / 2))
        return bool(np.all(np.abs(self.correlation) <= widened))


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
    tests = tuple(_cross(name, a, b, max_lag, level) for name, (a, b) in pairs.items())
    return HigherOrderTests(tests, level)


def _cross(name: str, a: np.ndarray, b: np.ndarray, max_lag: int, level: float) -> CrossTest:
    """Correlation of a (N,) with earlier b (N,); the bound is Bartlett's, from both autocorrelations."""
    N, a, b = len(a), a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    lags = np.arange(max_lag + 1)
    if scale <= 1e-12 * N * max(float(np.mean(np.abs(a))), 1e-300) * max(float(np.mean(np.abs(b))), 1e-300):
        return CrossTest(name, NAMES[name], lags, np.zeros(len(lags)), np.inf, level)
    r = np.array([a[k:] @ b[: N - k] for k in lags]) / scale
    ra, rb = (np.array([x[k:] @ x[: N - k] for k in lags]) / (x @ x) for x in (a, b))
    spread = float(1.0 + 2.0 * np.sum(ra[1:] * rb[1:]))
    z = float(ndtri(0.5 + level / 2.0))
    return CrossTest(name, NAMES[name], lags, r, z * float(np.sqrt(max(spread, 0.1) / N)), level)

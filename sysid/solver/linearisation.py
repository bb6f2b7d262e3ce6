"""A least-squares problem around one point, as the triangle of a QR: its steps, and the grain of its points."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

_EPS = np.finfo(float).eps
_PANEL = 16  # columns in one step of a QR
_SURE_DIGITS = 8  # behind the first, of a cost
_ROWS = 4096  # of J in one QR, then stacked on the next: more than this does not stay in a processor's cache


def column_scale(J: np.ndarray) -> np.ndarray:
    """Norm of each column of J (N, P); infinite where a column is practically zero, so that steps along it are zero."""
    norm = np.linalg.norm(J, axis=0)
    return np.where(norm > 1e-30 * norm.max(initial=0.0), norm, np.inf)


def rounded(p: np.ndarray, size: np.ndarray) -> np.ndarray:
    """p (P,) as multiples of the powers of two that are at most `size` (P,); p itself where that is 0."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        grain = np.exp2(np.floor(np.log2(size)))
        count = p / grain
        return np.where(np.abs(count) < 2.0**52, np.round(count) * grain, p)


def order_of(costs: Iterable[float]) -> np.ndarray:
    """The numbers (K,) of costs from the least on; those that differ in their last digits only stay in their order.

    These digits are another processor's, and where several ways lead to one optimum they would choose among them.
    """
    return np.argsort([float(f"{cost:.{_SURE_DIGITS}e}") for cost in costs], kind="stable")


class Rows:
    """The rows of e and J, added in pieces and kept as the triangle of a QR of [J e]: its size is that of J's columns.

    QR rather than J'J, which would square the condition number: the gauge leaves J without full rank, and only QR
    separates directions without effect from those with little.
    """

    def __init__(self, P: int) -> None:
        self.R: np.ndarray = np.zeros((P + 1, P + 1))
        self.cost, self.N = 0.0, 0

    def add(self, e: np.ndarray, J: np.ndarray) -> None:
        """Take up the next e (n,) and J (n, P)."""
        from scipy.linalg.lapack import dgeqrt  # a tenth of a second, which no help text waits for

        N, P = J.shape
        for start in range(0, N, _ROWS):
            rows = slice(start, min(start + _ROWS, N))
            A = np.empty((P + 1 + rows.stop - start, P + 1), order="F")  # the order of LAPACK, which avoids a copy
            A[: P + 1], A[P + 1 :, :P], A[P + 1 :, P] = self.R, J[rows], e[rows]
            self.R = np.triu(dgeqrt(min(_PANEL, P + 1), A, overwrite_a=True)[0][: P + 1])
        self.cost += float(e @ e)
        self.N += N

    @property
    def linearisation(self) -> "Linearisation":
        """All rows so far."""
        P = len(self.R) - 1
        return Linearisation(self.R[:P, :P], self.R[:P, P], self.cost, self.N)


@dataclass(frozen=True)
class Linearisation:
    """The problem around one point: e and J in the compact form R (P, P), z (P,), from a QR of [J e]."""

    R: np.ndarray
    z: np.ndarray
    cost: float  # e'e
    N: int

    @classmethod
    def of(cls, e: np.ndarray, J: np.ndarray) -> "Linearisation":
        """From e (N,) and J (N, P)."""
        rows = Rows(J.shape[1])
        rows.add(e, J)
        return rows.linearisation

    def along(self, directions: np.ndarray) -> "Linearisation":
        """The problem in some of its parameters only, marked by True (P,)."""
        if directions.all():
            return self
        P = int(directions.sum())
        A = np.column_stack([self.R[:, directions], self.z])
        R = np.asarray(np.linalg.qr(np.vstack([A, np.zeros((max(P - len(A), 0), P + 1))]), mode="r"))
        return Linearisation(R[:P, :P], R[:P, P], self.cost, self.N)

    @cached_property
    def scale(self) -> np.ndarray:
        """Norm of each column of J (P,), see `column_scale`."""
        return column_scale(self.R)

    @cached_property
    def svd(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """u'z, s, V of R with columns of unit norm, so that units do not decide which directions count as zero."""
        U, s, Vt = np.linalg.svd(self.R / self.scale)
        return U.T @ self.z, s, Vt.T

    @cached_property
    def deviation(self) -> np.ndarray:
        """Standard deviation (P,) of each parameter by itself, if the others were known; 0 where it has no effect."""
        return np.asarray(np.sqrt(self.cost / max(self.N, 1)) / self.scale)

    @property
    def noise_floor(self) -> float:
        """Singular values below this are zero: 1e4 eps max(size J) ||J||."""
        return 1e4 * _EPS * self.N * self.svd[1][0] if len(self.svd[1]) else 0.0

    def gauss_newton(self, floor: float) -> np.ndarray:
        """Step (P,) along the singular directions above `floor`."""
        uz, s, V = self.svd
        keep = s > floor
        return V[:, keep] @ (uz[keep] / s[keep]) / self.scale

    def damped(self, damping: float) -> np.ndarray:
        """Levenberg-Marquardt step (P,) in columns of unit norm."""
        uz, s, V = self.svd
        return V @ (uz * s / (s * s + damping)) / self.scale

    def scaled(self, delta: np.ndarray) -> np.ndarray:
        """Length of a step (P,) in columns of unit norm; directions that do not affect the output have length zero."""
        return np.where(np.isfinite(self.scale), delta * np.where(np.isfinite(self.scale), self.scale, 0.0), 0.0)

    @property
    def gradient(self) -> np.ndarray:
        """J'e (P,): the direction of steepest descent of e'e / 2."""
        return self.R.T @ self.z

    def predicted(self, delta: np.ndarray) -> float:
        """Drop of e'e that the linear model predicts for a step."""
        Rd = self.R @ delta
        return float(2.0 * (Rd @ self.z) - Rd @ Rd)

    @cached_property
    def expected_improvement(self) -> float:
        """Predicted drop of e'e for a full Gauss-Newton step, in % of e'e."""
        if self.cost <= 0.0:
            return 0.0
        uz, s, _ = self.svd
        return 100.0 * float(np.sum(uz[s > self.noise_floor] ** 2)) / self.cost

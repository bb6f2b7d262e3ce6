"""The loop of every search: linearise, compute a step, stop with a reason."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy.linalg.lapack import dgeqrt

from sysid.base.checks import checked

_EPS = np.finfo(float).eps
_GRAIN = 1e-3  # of a standard deviation: the grid of the iterates, see `Linearisation.grain`
_LARGEST = 1e150  # derivative: squares of larger ones are not numbers
_PANEL = 16  # columns in one step of a QR
_ROWS = 4096  # of J in one QR, then stacked on the next: more than this does not stay in a processor's cache


class Problem(Protocol):
    """A least-squares problem in the free parameters p (P,)."""

    @property
    def size(self) -> float:
        """y'y: the reference for a cost of zero."""
        ...

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """e = y - yhat (N,), or None if p gives no valid model."""
        ...

    def repair(self, p: np.ndarray) -> np.ndarray:
        """The valid point used in place of p; p itself if it is valid."""
        ...

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """True (P,) where p is at a bound and the descent direction points beyond it."""
        ...

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dp (N, P)."""
        ...


@runtime_checkable
class Compact(Protocol):
    """A problem that can do without the whole J where a record is long."""

    def compact(self, p: np.ndarray) -> "Linearisation | None":
        """`linearise` in compact form; None where the record is short enough for J."""
        ...


@runtime_checkable
class Anchored(Protocol):
    """A problem whose p counts from an anchor (P,): points are rounded as anchor + p."""

    @property
    def anchor(self) -> np.ndarray: ...


@checked
@dataclass(frozen=True)
class Options:
    """Stopping options of a search. After `max_seconds` a fit ends with the best that its searches found so far.

    The clock is looked at between steps; the first fit of a kind in a process also compiles or loads its blocks.
    """

    max_iterations: int = 200
    tolerance: float = 0.01  # [%] of the loss: expected improvement of a Gauss-Newton step
    max_halvings: int = 25
    max_seconds: float = np.inf
    deadline: float = np.inf  # [s] of time.monotonic(): one for all searches of a fit, see `begun`

    def begun(self) -> "Options":
        """The options of a fit that begins now."""
        return replace(self, deadline=min(self.deadline, time.monotonic() + self.max_seconds))


_UNTIL: ContextVar[float] = ContextVar("until", default=np.inf)


@contextmanager
def time_limit(deadline: float) -> Iterator[None]:
    """Searches inside end at `deadline` [s of time.monotonic()], whatever options they have: those of starts."""
    previous = _UNTIL.set(min(deadline, _UNTIL.get()))
    try:
        yield
    finally:
        _UNTIL.reset(previous)


SMALL = 1.0  # [%] of the loss; with N samples noise alone moves the loss by 100 sqrt(2 / N) %


@dataclass(frozen=True)
class Stop:
    """The reason why a search ended."""

    reason: str
    converged: bool
    iterations: int
    evaluations: int


@dataclass(frozen=True)
class Step:
    """A change of the parameters that lowered the cost."""

    delta: np.ndarray
    cost: float
    method: str


def column_scale(J: np.ndarray) -> np.ndarray:
    """Norm of each column of J (N, P); infinite where a column is practically zero, so that steps along it are zero."""
    norm = np.linalg.norm(J, axis=0)
    return np.where(norm > 1e-30 * norm.max(initial=0.0), norm, np.inf)


def rounded(p: np.ndarray, grain: np.ndarray) -> np.ndarray:
    """p (P,) as multiples of `grain` (P,), where that is not 0 and p is finite."""
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        steps = p / grain
        return np.where(np.abs(steps) < 2.0**52, np.round(steps) * grain, p)


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
    def grain(self) -> np.ndarray:
        """Powers of two (P,), at most a thousandth of the standard deviation of each parameter by itself.

        Iterates are multiples of these: what another processor changes in the last digits of a step is then rounded
        away instead of growing from step to step, and the loss is higher by at most P 1e-6 / N of it.
        """
        size = np.sqrt(self.cost / max(self.N, 1)) / self.scale
        return np.where(size > 0.0, np.exp2(np.floor(np.log2(np.where(size > 0.0, _GRAIN * size, 1.0)))), 0.0)

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


# Result of a trial step: the cost after it and the step taken (corrected if it left the bounds).
Attempt = Callable[[np.ndarray], tuple[float, np.ndarray]]


class Search(Protocol):
    """A method to compute a step; `memory` stores its state between iterations."""

    name: str

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        """A step that lowers the cost, or None if the method finds none."""
        ...


def halve(
    lin: Linearisation, direction: np.ndarray, attempt: Attempt, max_halvings: int, method: str
) -> tuple[Step | None, int]:
    """First of direction, direction/2, ... that lowers the cost by enough of the prediction, and halvings."""
    for k in range(max_halvings + 1):
        cost, delta = attempt(direction * 0.5**k)
        if cost < lin.cost - 1e-4 * max(lin.predicted(delta), 0.0):
            return Step(delta, cost, method), k
    return None, max_halvings


def within_radius(
    lin: Linearisation,
    attempt: Attempt,
    memory: dict[str, Any],
    options: Options,
    shortest: Callable[[Linearisation, float], np.ndarray],
    method: str,
) -> Step | None:
    """The first step `shortest(lin, radius)` (P,) that lowers the cost, within an adaptive radius.

    Radii are in columns of unit norm. A step with less than a quarter of the predicted decrease reduces the radius to
    a quarter; a step with more than three quarters increases it (Nocedal and Wright, Numerical Optimization, ch. 4).
    """
    radius = memory.get("radius") or float(np.linalg.norm(lin.scaled(lin.damped(1e-3))))
    for _ in range(2 * options.max_halvings):
        proposal = shortest(lin, radius)
        length = float(np.linalg.norm(lin.scaled(proposal)))
        cost, delta = attempt(proposal)
        drop = lin.predicted(delta)
        ratio = (lin.cost - cost) / drop if drop > 0 and np.isfinite(cost) else -1.0
        if ratio > 1e-4:
            if ratio > 0.75:
                radius = max(radius, 2.5 * length)
            elif ratio < 0.25:
                radius = 0.25 * length
            memory["radius"] = radius
            return Step(delta, cost, method)
        radius = 0.25 * min(radius, length)
    memory["radius"] = None
    return None


@dataclass(frozen=True)
class Outcome:
    """The result of a search."""

    p: np.ndarray
    cost: float
    stop: Stop
    history: tuple[dict[str, Any], ...] = field(default=())

    def then(self, continuation: "Outcome") -> "Outcome":
        """This search and its continuation as one result."""
        iterations = self.stop.iterations
        stop = replace(
            continuation.stop,
            iterations=iterations + continuation.stop.iterations,
            evaluations=self.stop.evaluations + continuation.stop.evaluations,
        )
        rows = tuple({**row, "iteration": row["iteration"] + iterations} for row in continuation.history)
        return Outcome(continuation.p, continuation.cost, stop, self.history + rows)


def linearise_free(problem: Problem, p: np.ndarray) -> tuple[Linearisation, np.ndarray]:
    """The problem around p in the directions that no bound blocks, and True (P,) for these."""
    lin = problem.compact(p) if isinstance(problem, Compact) else None
    if lin is not None:
        moving = ~problem.blocked(p, lin.gradient)
        return lin.along(moving), moving
    e, J = problem.linearise(p)
    moving = ~problem.blocked(p, J.T @ e)
    return Linearisation.of(e, J if moving.all() else J[:, moving]), moving


def iterate(
    problem: Problem,
    p0: np.ndarray,
    search: Search,
    options: Options,
    progress: Callable[[int, float], None] | None = None,
) -> Outcome:
    """Run `search` from p0 (P,) until the expected improvement is below the tolerance, or a limit is reached."""
    p, evaluations, moving = np.array(p0), 0, np.ones(len(p0), dtype=bool)
    anchor = problem.anchor if isinstance(problem, Anchored) else np.zeros(len(p))
    memory: dict[str, Any] = {}
    history: list[dict[str, Any]] = []
    trials: list[tuple[np.ndarray, np.ndarray]] = []
    e = problem.residual(p)
    if e is None or not np.all(np.isfinite(e)):
        return Outcome(p, np.inf, Stop("the starting point is not a valid model", False, 0, 1))
    cost, reason, converged, iteration = float(e @ e), "", False, 0
    del e  # a long record does without it

    def attempt(delta: np.ndarray) -> tuple[float, np.ndarray]:
        """The cost at p + delta, repaired where it leaves the bounds, and the step that was taken."""
        nonlocal evaluations
        evaluations += 1
        target = p.copy()
        target[moving] = rounded((anchor + p)[moving] + delta, lin.grain) - anchor[moving]
        target = problem.repair(target)
        e = problem.residual(target)
        with np.errstate(over="ignore"):  # a diverging trial may be finite while its square is not
            trial = float(e @ e) if e is not None else np.inf
        trials.append(((target - p)[moving], target))
        return (trial if np.isfinite(trial) else np.inf), trials[-1][0]

    for iteration in range(options.max_iterations + 1):
        if cost <= problem.size * (100.0 * _EPS) ** 2:
            reason, converged = "the loss is zero to rounding", True
            break
        if time.monotonic() > _UNTIL.get():
            reason = "the time of the fit is over"
            break
        with np.errstate(over="ignore", invalid="ignore"):  # see _LARGEST
            lin, moving = linearise_free(problem, p)
        evaluations += 1
        if not np.all(np.abs(lin.R) < _LARGEST):
            reason = "the derivatives of the model are too large for numbers"
            break
        improvement = lin.expected_improvement
        if improvement <= options.tolerance:
            reason = (
                f"expected improvement {improvement:.2g} % of the loss, below the tolerance of {options.tolerance:g} %"
            )
            converged = True
            break
        if time.monotonic() > options.deadline:
            reason = f"limit of {options.max_seconds:g} s reached; expected improvement still {improvement:.2g} %"
            break
        if iteration == options.max_iterations:
            reason = (
                f"limit of {options.max_iterations} iterations reached; expected improvement still {improvement:.2g} %"
            )
            break
        trials.clear()
        step = search.step(lin, attempt, memory, options)
        if step is None:
            reason = (
                f"{search.name} found no descent although the expected improvement is {improvement:.2g} % of the loss"
            )
            converged = improvement <= SMALL  # a kink or a bound prevents a small expected improvement
            break
        # The point that was tried: p + delta may round to one beyond a bound.
        p, cost = next(target for delta, target in trials if delta is step.delta), step.cost
        history.append(
            {"iteration": iteration + 1, "loss": cost / lin.N, "method": step.method, "expected": improvement}
        )
        if progress is not None:
            progress(iteration + 1, cost / lin.N)
        if stalled(history):
            # Kinks of a map can prevent the expected improvement; a loss that no longer falls ends the search too.
            converged = improvement <= SMALL
            reason = f"the loss fell by less than {100 * _STILL:g} % over the last {_STALL} iterations"
            if not converged:
                reason += f", although {improvement:.2g} % was still expected: a kink of a map or a bound is in the way"
            break
    return Outcome(p, cost, Stop(reason, converged, iteration, evaluations), tuple(history))


_STALL, _STILL = 4, 1e-5


def stalled(history: list[dict[str, Any]]) -> bool:
    """True if the last few steps together changed almost nothing."""
    if len(history) <= _STALL:
        return False
    return history[-_STALL - 1]["loss"] - history[-1]["loss"] < _STILL * history[-1]["loss"]

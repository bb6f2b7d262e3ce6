"""The loop of every search: linearise, compute a step, stop with a reason."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sysid.base.checks import checked
from sysid.solver.linearisation import Linearisation, rounded

_EPS = np.finfo(float).eps
_LARGEST = 1e150  # derivative: squares of larger ones are not numbers


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
    grain: float = 1e-3  # of a parameter's standard deviation and of its step: points of a search are rounded to it
    first_grain: float = 0.0  # of the standard deviation: the first point is rounded to it
    max_seconds: float = np.inf
    deadline: float = np.inf  # [s] of time.monotonic(): one for all searches of a fit, see `begun`

    @classmethod
    def from_estimate(cls, max_iterations: int, tolerance: float = 0.1) -> "Options":
        """A few steps from an estimate, whose last digits are lost already by the condition of its equations."""
        return cls(max_iterations, tolerance, first_grain=ESTIMATE)

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


_NO_STEP = 1e-9  # of a standard deviation: less is rounding, and the sign of a speed that is 0 would decide
ESTIMATE = 0.1  # of a standard deviation: a start is not better than that
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
    """Run `search` from p0 (P,) until the expected improvement is below the tolerance, or a limit is reached.

    Points are rounded: what another processor changes in the last digits of a step is then lost, where it would grow
    from step to step to another optimum.
    """
    p, evaluations, moving = np.array(p0), 0, np.ones(len(p0), dtype=bool)
    anchor = problem.anchor if isinstance(problem, Anchored) else np.zeros(len(p))
    memory: dict[str, Any] = {}
    history: list[dict[str, Any]] = []
    trials: list[tuple[np.ndarray, np.ndarray]] = []
    e = problem.residual(p)
    with np.errstate(over="ignore"):  # a start that runs away may be finite while its square is not
        cost = np.inf if e is None else float(e @ e)
    if not np.isfinite(cost):
        return Outcome(p, np.inf, Stop("the starting point is not a valid model", False, 0, 1))
    improvement, reason, converged, iteration = np.inf, "", False, 0
    del e  # a long record does without it

    def attempt(delta: np.ndarray) -> tuple[float, np.ndarray]:
        """The cost at p + delta, repaired where it leaves the bounds, and the step that was taken."""
        nonlocal evaluations
        evaluations += 1
        target = p.copy()
        grain = options.grain * np.minimum(lin.deviation, np.abs(delta))
        step = np.where(np.abs(delta) > _NO_STEP * lin.deviation, delta, 0.0)
        target[moving] = rounded((anchor + p)[moving] + step, grain) - anchor[moving]
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
        if 0 < iteration == options.max_iterations:  # whether it could go on would take a Jacobian that nobody uses
            reason = f"limit of {iteration} iterations reached; expected improvement of the last {improvement:.2g} %"
            break
        if iteration == 0 and options.first_grain:
            p, cost = _rounded_start(problem, p, cost, anchor, options.first_grain)
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
            reason = f"limit of 0 iterations reached; expected improvement still {improvement:.2g} %"
            break
        trials.clear()
        step = search.step(lin, attempt, memory, options)
        if step is None:
            reason = (
                f"no step lowers the loss, although {improvement:.2g} % less was expected: a kink of a map or a bound "
                "is in the way"
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
        still = min(_STILL, options.tolerance / 100.0)  # who asks for more digits waits for them
        if stalled(history, still):
            # Kinks of a map can prevent the expected improvement; a loss that no longer falls ends the search too.
            converged = improvement <= SMALL
            reason = f"the loss fell by less than {100 * still:g} % over the last {_STALL} iterations"
            if not converged:
                reason += f", although {improvement:.2g} % was still expected: a kink of a map or a bound is in the way"
            break
    return Outcome(p, cost, Stop(reason, converged, iteration, evaluations), tuple(history))


def _rounded_start(
    problem: Problem, p: np.ndarray, cost: float, anchor: np.ndarray, grain: float
) -> tuple[np.ndarray, float]:
    """p (P,) rounded to `grain` standard deviations, and its cost; p itself where that is no valid model."""
    with np.errstate(over="ignore", invalid="ignore"):
        lin, moving = linearise_free(problem, p)
        start = anchor + p
        start[moving] = rounded(start[moving], grain * lin.deviation)
        start = problem.repair(start - anchor)
        e = problem.residual(start)
    return (start, float(e @ e)) if e is not None and np.all(np.isfinite(e)) else (p, cost)


_STALL, _STILL = 4, 1e-5


def stalled(history: list[dict[str, Any]], still: float = _STILL) -> bool:
    """True if the last few steps together lowered the loss by less than the share `still`."""
    if len(history) <= _STALL:
        return False
    return history[-_STALL - 1]["loss"] - history[-1]["loss"] < still * history[-1]["loss"]

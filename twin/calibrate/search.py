"""Search for the parameters of a simulation: one descent, or several from drawn starts."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.solver.iterate import Options, Outcome, Stop, iterate
from sysid.solver.searches import search
from twin.calibrate.problem import Simulations

AGREE = 1.02  # descents whose loss is at most this times the best one's have found the same place
GOOD = 0.1  # of the standard deviation of the output: from a start with a smaller residual no others are tried
ITERATIONS = 15
COARSE, TOLERANCE = 1.0, 0.02  # [%] of the loss: expected improvement that ends the search
TRIES = 2  # radii tried for a step are twice this: where none of them descends, the response jumps and no other would
USUAL = Options(ITERATIONS, COARSE, TRIES)


@dataclass(frozen=True)
class Optimum:
    """Coordinates p (n,), the sum of squares there and at the start, why the search stopped, and its iterations.

    `descents` were made from different starts and `agreed` of them reached the best loss. `late`: the time was over
    before the search had ended, or before all starts were followed.
    """

    p: np.ndarray
    cost: float
    first: float
    stop: Stop
    history: tuple[dict, ...]
    descents: int
    agreed: int
    late: bool = False


def find_optimum(
    problem: Simulations,
    rng: np.random.Generator,
    draws: int = 24,
    descents: int = 2,
    progress: Callable[[int, float], None] | None = None,
    options: Options = USUAL,
) -> Optimum:
    """A trust region from the start and, if the residual there is large, from the best of `draws` drawn ones.

    Starts are drawn one scale around the first one, in one batch, and the best `descents` of all are followed; the loss
    of a joint between stops has other minima than the best, where a stop is reached too late or too early. After the
    deadline of `options` it ends with the best so far: at the first start, if nothing was searched yet.
    """
    points = problem.start[None]
    e = problem.residual(problem.start)
    first = np.inf if e is None else float(e @ e)
    if time.monotonic() > options.deadline:  # a Jacobian that leads to no step takes as long as all of the rest
        problem.central = True
        stop = Stop(f"limit of {options.max_seconds:g} s reached before the first step", False, 0, 1)
        return Optimum(problem.start, first, first, stop, (), 0, 0, True)
    if not first < GOOD**2 * problem.spread and draws:
        starts = problem.repair(problem.start + rng.standard_normal((draws, len(problem.free))))
        points = np.concatenate([points, starts])
        losses = problem.losses(points)
        points = points[np.argsort(losses)[:descents]]
    outcomes = [descend(problem, points[0], progress, options)]
    for p in points[1:]:
        if time.monotonic() > options.deadline:
            break
        outcomes.append(descend(problem, p, progress, options))
    best = min(outcomes, key=lambda outcome: outcome.cost)
    n_agreed = sum(outcome.cost <= AGREE * best.cost for outcome in outcomes)
    late = time.monotonic() > options.deadline and (not best.stop.converged or len(outcomes) < len(points))
    return Optimum(best.p, best.cost, first, best.stop, best.history, len(outcomes), n_agreed, late)


def descend(
    problem: Simulations, p: np.ndarray, progress: Callable[[int, float], None] | None, options: Options
) -> Outcome:
    """Forward differences as far as they lead, then central ones: near-equal columns need slopes without curvature."""
    method = search("trust_region")
    problem.central = False
    coarse = iterate(problem, p, method, options, progress)
    problem.central = True
    if time.monotonic() > options.deadline:
        return replace(coarse, stop=replace(coarse.stop, converged=False))
    return coarse.then(iterate(problem, coarse.p, method, replace(options, tolerance=TOLERANCE), progress))

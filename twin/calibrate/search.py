"""Search for the parameters of a simulation: one descent, or several from drawn starts."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.solver.iterate import Options, Outcome, Stop, iterate
from sysid.solver.searches import search
from twin.calibrate.problem import Simulations

AGREE = 1.02  # descents whose loss is at most this times the best one's have found the same place
GOOD = 4.0  # times the noise: from a start with a smaller residual no other starts are tried
ITERATIONS = 15
TOLERANCE = 0.02  # [%] of the loss


@dataclass(frozen=True)
class Found:
    """Coordinates p (n,), the sum of squares there and at the start, why the search stopped, and its iterations.

    `descents` were made from different starts and `agreed` of them reached the best loss.
    """

    p: np.ndarray
    cost: float
    first: float
    stop: Stop
    history: tuple[dict, ...]
    descents: int
    agreed: int


def find(
    problem: Simulations,
    rng: np.random.Generator,
    draws: int = 24,
    descents: int = 3,
    progress: Callable[[int, float], None] | None = None,
) -> Found:
    """Levenberg-Marquardt from the start and, if the residual there is large, from the best of `draws` drawn ones.

    Starts are drawn one scale around the first one, in one batch, and the best `descents` of all are followed; the loss
    of a joint between stops has other minima than the best, where a stop is reached too late or too early.
    """
    points = problem.start[None]
    first = float(problem.losses(points)[0])
    N = sum(problem.lengths)
    if not first < N * (GOOD * problem.noise) ** 2 and draws:
        away = problem.repair(problem.start + rng.standard_normal((draws, len(problem.free))))
        points = np.concatenate([points, away])
        losses = problem.losses(points)
        points = points[np.argsort(losses)[:descents]]
    outcomes = [_descend(problem, p, progress) for p in points]
    best = min(outcomes, key=lambda outcome: outcome.cost)
    agreed = sum(outcome.cost <= AGREE * best.cost for outcome in outcomes)
    return Found(best.p, best.cost, first, best.stop, best.history, len(outcomes), agreed)


def _descend(problem: Simulations, p: np.ndarray, progress: Callable[[int, float], None] | None) -> Outcome:
    return iterate(problem, p, search("lm"), Options(ITERATIONS, TOLERANCE, 12), progress)

"""Starts of a joint with more physics: a simpler joint is fitted first; the added parts start from its optimum.

The cost over friction curves and backlash has many local minima. The right one is visible only when everything else
already fits.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from sysid.blocks import CoastingPlay, Motor, Play
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.joint_parts import FRICTIONS, friction_starts, lift_theta, motor_of, plainer, without_play
from sysid.estimation.problem import ChainProblem, search_best
from sysid.estimation.starts._start import Start
from sysid.estimation.starts.joint import Joint
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, iterate
from sysid.solver.linearisation import order_of
from sysid.solver.searches import LevenbergMarquardt

_STEPS = Options(max_iterations=60, tolerance=0.01)
_TRIED = 4  # starts of the plainest joint
_RANK = 1e-6  # of the largest singular value
_ROUNDING = 1e-20  # of the squared size of what is projected out
_WIDTH = 0.005  # of the range of y: the play that is tried
_DRAGS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # widths a sample^2
_PULL = 8.0  # widths a sample^2 at half the range from where the link hangs
_HANGS = np.linspace(0.1, 0.9, 9)  # of the range of y
_HOLDS = (0.0, 0.1, 0.25, 0.45, 0.8)  # of half the range about there, within which the drag holds the link
Links = Callable[[float, float], Iterator[tuple[float, ...]]]  # parameters of backlashes between two ends


class StagedJoint(Start):
    """A chain with a motor for which `plainer` gives a chain."""

    blocks = (Motor,)

    def suits(self, chain: Chain) -> bool:
        return plainer(chain) is not None

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        plain, middle = plainer(chain), without_play(chain)
        assert plain is not None
        theta = _best(plain, Joint().starts(plain, data, _TRIED, seed), data)
        if middle != plain:
            names = tuple(name for name in FRICTIONS if getattr(motor_of(chain), name, False))
            points = [lift_theta(plain, theta, middle, part) for part in friction_starts(names, plain, theta, data)]
            theta = _best(middle, points, data)
        if middle is chain:
            return [theta]
        return [lift_theta(middle, theta, chain, part) for part in play_starts(chain, middle, theta, data)[:count]]


def _best(chain: Chain, points: list[np.ndarray], data: IOData) -> np.ndarray:
    """theta (P,) of the first experiment after the best of searches from these points."""
    problems = (
        ChainProblem(chain, with_initial_states(chain, theta, data), tuple(data.experiments), chain.free)
        for theta in points
    )
    return search_best(problems, _STEPS, points[0])[0]


def play_starts(
    chain: Chain, middle: Chain, theta: np.ndarray, data: IOData, links: Links | None = None
) -> list[dict[str, float]]:
    """Parameters of the backlash by name, ordered by the expected reduction of the cost of `middle` at theta.

    `middle` is the chain without the backlash; `links` gives the backlashes between two ends that are tried. The output
    change of the backlash is compared with the residuals after projection on the model's sensitivities; the share of
    the change that fits best gives the width.
    """
    play = next(b for b in chain.blocks if isinstance(b, Play | CoastingPlay))
    k = chain.blocks.index(play)
    problem = ChainProblem(middle, with_initial_states(middle, theta, data), tuple(data.experiments), middle.free)
    problem = replace(problem, theta0=problem.thetas(iterate(problem, problem.start, LevenbergMarquardt(), _STEPS).p))
    e, J = problem.linearise(problem.start)
    # Of columns that depend on each other a QR would take directions of rounding too.
    Q, size, _ = np.linalg.svd(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300), full_matrices=False)
    Q = Q[:, size > _RANK * size[0]]
    residuals = e - Q @ (Q.T @ e)
    runs = list(zip(problem.theta0, problem.records, strict=True))
    inputs = [middle.through(row, r.u[:, 0], 0, k) for row, r in runs]
    plain = [middle.through(row, x, k, None) for (row, _), x in zip(runs, inputs, strict=True)]
    low, high = min(x.min() for x in inputs), max(x.max() for x in inputs)
    rows = []
    links = links or (_links if isinstance(play, CoastingPlay) else _widths)
    for part in links(low, high):
        changes = []
        for (row, r), x, y in zip(runs, inputs, plain, strict=True):
            z = play.output(np.array(part), x)
            change = middle.through(row, z, k, None) - y
            changes.append(change if r.missing is None else change[r.observed[:, 0]])
        cost, share = _best_share(np.concatenate(changes), residuals, Q)
        rows.append((cost, (share * part[0], *part[1:])))
    rows = [rows[k] for k in order_of(cost for cost, _ in rows)]  # some links act alike
    names = [f"{play.role}.{slot.name}" for slot in play.slots()]
    return [dict(zip(names, part, strict=True)) for _, part in rows]


def _best_share(change: np.ndarray, residuals: np.ndarray, Q: np.ndarray) -> tuple[float, float]:
    """Cost of the residuals after subtraction of the best share of `change`, and that share."""
    before = float(change @ change)
    change = change - Q @ (Q.T @ change)
    size = float(change @ change)
    # What is left of a change that the other parameters give as well is rounding, and tells no share.
    share = float(np.clip(change @ residuals / size, 0.2, 5.0)) if size > _ROUNDING * before else 1.0
    return float(np.sum((residuals - share * change) ** 2)), share


def _widths(low: float, high: float) -> Iterator[tuple[float, ...]]:
    """width, rest of plays."""
    for share in (0.4, 1.0, 3.0):
        yield share * _WIDTH * (high - low), 0.0


def _links(low: float, high: float) -> Iterator[tuple[float, ...]]:
    """width, rest, drag, pull0, pull1 of candidates: links without weight, and links that hang or stand."""
    width, half = _WIDTH * (high - low), 0.5 * (high - low)
    for drag in _DRAGS:
        yield width, 0.0, drag * width, 0.0, 0.0
    for share in _HANGS:
        hang = low + share * (high - low)
        for slope in (_PULL * width / half, -_PULL * width / half):
            for hold in _HOLDS:
                yield width, 0.0, hold * half * abs(slope), -slope * hang, slope

"""Starts of a joint with more physics: a simpler joint is fitted first; the added parts start from its optimum.

The cost over friction curves and backlash has many local minima. The right one is visible only when everything else
already fits.
"""

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.joint_parts import FRICTIONS, friction_starts, is_joint, lifted, motor_of, plainer, without_play
from sysid.estimation.play_start import play_starts
from sysid.estimation.problem import ChainProblem
from sysid.estimation.start import Start
from sysid.estimation.starts.joint import Joint
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import LevenbergMarquardt

_STEPS = Options(max_iterations=60, tolerance=0.01)
_TRIED = 4  # starts of the plainest joint


class StagedJoint(Start):
    """A chain with a motor for which `plainer` gives a chain."""

    def applies(self, chain: Chain) -> bool:
        return is_joint(chain) and plainer(chain) is not None

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        plain, middle = plainer(chain), without_play(chain)
        assert plain is not None
        found = _best(plain, Joint().starts(plain, data, _TRIED, seed), data)
        if middle != plain:
            names = tuple(name for name in FRICTIONS if getattr(motor_of(chain), name, False))
            points = [lifted(plain, found, middle, more) for more in friction_starts(names, plain, found, data)]
            found = _best(middle, points, data)
        if middle is chain:
            return [found]
        return [lifted(middle, found, chain, more) for more in play_starts(chain, middle, found, data)[:count]]


def _best(chain: Chain, points: list[np.ndarray], data: IOData) -> np.ndarray:
    best, least = points[0], np.inf
    for theta in points:
        problem = ChainProblem(chain, with_initial_states(chain, theta, data), tuple(data.experiments), chain.free)
        outcome = iterate(problem, problem.start, LevenbergMarquardt(), _STEPS)
        if outcome.cost < least:
            best, least = problem.thetas(outcome.p)[0], outcome.cost
    return best

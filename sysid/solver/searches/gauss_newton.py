"""Steps from the least-squares linearisation: Gauss-Newton, with a threshold that adapts, and Levenberg-Marquardt."""

from typing import Any

from sysid.solver.iterate import Attempt, Options, Step, halve
from sysid.solver.linearisation import Linearisation

_GAMMA = 1e-4  # start of the adaptive threshold; times 2 after five halvings, a quarter after a full step
_DAMPING, _FACTOR, _FLOOR, _CEILING = 1e-3, 2.0, 1e-14, 1e9  # of Levenberg-Marquardt


class GaussNewton:
    """gn: singular values below 1e4 eps max(size J) ||J|| count as zero."""

    name = "gn"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        return halve(lin, lin.gauss_newton(lin.noise_floor), attempt, options.max_halvings, self.name)[0]


class AdaptiveGaussNewton:
    """gna: ignores singular values below gamma times the largest (Wills and Ninness 2008, Automatica 44)."""

    name = "gna"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        gamma = memory.get("gamma", _GAMMA)
        largest = lin.svd[1][0] if len(lin.svd[1]) else 0.0
        result = None
        while result is None and gamma < 1.0:
            result, halvings = halve(lin, lin.gauss_newton(gamma * largest), attempt, 5, self.name)
            if result is None:
                gamma *= 2.0
            elif halvings == 0:
                gamma /= 4.0
        memory["gamma"] = min(max(gamma, 1e-14), 0.5)
        return result


class LevenbergMarquardt:
    """lm: damping from 1e-3, doubled until the loss falls, lowered by the ratio of actual to predicted reduction.

    The columns have unit norm: Marquardt's scaling (More 1978) makes it independent of units. The reduction by the
    gain ratio follows Nielsen 1999.
    """

    name = "lm"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        damping, growth = memory.get("damping", _DAMPING), _FACTOR
        while damping < _CEILING:
            cost, delta = attempt(lin.damped(damping))
            drop = lin.predicted(delta)
            if cost < lin.cost - 1e-4 * max(drop, 0.0):
                ratio = (lin.cost - cost) / drop if drop > 0 else 0.0
                memory["damping"] = max(damping * max(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3), _FLOOR)
                return Step(delta, cost, self.name)
            damping *= growth
            growth = min(growth * _FACTOR, 64.0)  # doubles at first, then faster: most failures need much more
        memory["damping"] = _DAMPING
        return None

"""Levenberg-Marquardt in columns of unit norm."""

from typing import Any

from sysid.solver.iterate import Attempt, Linearisation, Options, Step

_DAMPING, _FACTOR, _FLOOR, _CEILING = 1e-3, 2.0, 1e-14, 1e9


class LevenbergMarquardt:
    """lm: damping from 1e-3, doubled until the loss falls, lowered by the ratio of actual to predicted reduction.

    Marquardt's scaling (More 1978) makes it independent of units; the reduction by the gain ratio follows Nielsen 1999.
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

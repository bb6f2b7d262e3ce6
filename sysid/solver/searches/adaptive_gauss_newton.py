"""Adaptive Gauss-Newton: the threshold of ignored singular values follows the number of halvings of a step."""

from typing import Any

from sysid.solver.iterate import Attempt, Linearisation, Options, Step, halve

_GAMMA = 1e-4  # start; times 2 after five halvings, a quarter after a full step


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

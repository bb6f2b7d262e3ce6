"""Trust region: the minimum of the linear model within an adaptive radius."""

from typing import Any

import numpy as np

from sysid.solver.iterate import Attempt, Options, Step
from sysid.solver.linearisation import Linearisation


class TrustRegion:
    """trust_region: the exact solution of the subproblem (More and Sorensen 1983), found by SciPy's `brentq`.

    Radii are in columns of unit norm. A step with less than a quarter of the predicted decrease reduces the radius to
    a quarter; a step with more than three quarters increases it (Nocedal and Wright, Numerical Optimization, ch. 4).
    """

    name = "trust_region"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        radius = memory.get("radius") or float(np.linalg.norm(lin.scaled(lin.damped(1e-3))))
        for _ in range(2 * options.max_halvings):
            proposal = shortest_step(lin, radius)
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
                return Step(delta, cost, self.name)
            radius = 0.25 * min(radius, length)
        memory["radius"] = None
        return None


def shortest_step(lin: Linearisation, radius: float) -> np.ndarray:
    """Minimum of the linear model (P,) among steps no longer than `radius` in columns of unit norm."""
    from scipy.optimize import brentq  # a fifth of a second, which no help text waits for

    uz, s, _ = lin.svd
    full = lin.gauss_newton(lin.noise_floor)
    if np.linalg.norm(lin.scaled(full)) <= radius:
        return full

    def excess(log_damping: float) -> float:
        return float(np.log(np.linalg.norm(uz * s / (s * s + np.exp(log_damping))) / radius))

    # The bracket is from no damping (the step is too long) to a damping so large that |uz s| / damping < radius.
    low, high = -80.0, float(np.log(np.linalg.norm(uz * s) / radius)) + 1.0
    if excess(low) <= 0.0 or excess(high) >= 0.0:
        return full * radius / float(np.linalg.norm(lin.scaled(full)))
    return lin.damped(float(np.exp(brentq(excess, low, high, xtol=1e-6))))

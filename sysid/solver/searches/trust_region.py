"""Trust region: the best step of the linear model within a radius that grows and shrinks with its success."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

from sysid.solver.iterate import Attempt, Linearisation, Options, Step


class TrustRegion:
    """trust_region: the exact solution of the subproblem (More and Sorensen 1983), found by SciPy's `brentq`.

    Radii are in columns of unit norm. If the actual reduction is below a quarter of the predicted one, the radius
    shrinks to a quarter; above three quarters it grows (Nocedal and Wright, Numerical Optimization, ch. 4).
    """

    name = "trust_region"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        radius = memory.get("radius") or float(np.linalg.norm(lin.scaled(lin.damped(1e-3))))
        for _ in range(2 * options.max_halvings):
            proposed = within(lin, radius)
            length = float(np.linalg.norm(lin.scaled(proposed)))
            cost, delta = attempt(proposed)
            promised = lin.predicted(delta)
            ratio = (lin.cost - cost) / promised if promised > 0 and np.isfinite(cost) else -1.0
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


def within(lin: Linearisation, radius: float) -> np.ndarray:
    """Minimum of the linear model (P,) among steps no longer than `radius` in columns of unit norm."""
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

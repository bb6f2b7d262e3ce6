"""Trust region: the minimum of the linear model within an adaptive radius."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

from sysid.solver.iterate import Attempt, Options, Step, within_radius
from sysid.solver.linearisation import Linearisation


class TrustRegion:
    """trust_region: the exact solution of the subproblem (More and Sorensen 1983), found by SciPy's `brentq`.

    `within_radius` adapts the radius.
    """

    name = "trust_region"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        return within_radius(lin, attempt, memory, options, shortest_step, self.name)


def shortest_step(lin: Linearisation, radius: float) -> np.ndarray:
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

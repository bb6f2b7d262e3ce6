"""Steepest descent, scaled by the minimum of the linear model along it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sysid.iterate import Linearisation, Options, Step, halve


class Gradient:
    """gradient: slow near the optimum; a last resort of `auto`."""

    name = "gradient"

    def step(
        self, lin: Linearisation, cost_at: Callable[[np.ndarray], float], memory: dict[str, Any], options: Options
    ) -> Step | None:
        g = lin.gradient / lin.scale**2
        Rg = lin.R @ g
        size = float(Rg @ Rg)
        if size <= 0.0:
            return None
        return halve(lin, g * float(Rg @ lin.z) / size, cost_at, options.max_halvings, self.name)[0]

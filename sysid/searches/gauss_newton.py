"""Gauss-Newton over the singular directions above the noise floor, halved until it descends."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sysid.iterate import Linearisation, Options, Step, halve


class GaussNewton:
    """gn: singular values below 1e4 eps max(size J) ||J|| count as zero."""

    name = "gn"

    def step(
        self, lin: Linearisation, cost_at: Callable[[np.ndarray], float], memory: dict[str, Any], options: Options
    ) -> Step | None:
        return halve(lin, lin.gauss_newton(lin.noise_floor), cost_at, options.max_halvings, self.name)[0]

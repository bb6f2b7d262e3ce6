"""Steepest descent, scaled by the minimum of the linear model along it."""

from typing import Any

from sysid.solver.iterate import Attempt, Options, Step, halve
from sysid.solver.linearisation import Linearisation


class Gradient:
    """gradient: slow near the optimum; a last resort of `auto`."""

    name = "gradient"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        g = lin.gradient / lin.scale**2
        Rg = lin.R @ g
        size = float(Rg @ Rg)
        if size <= 0.0:
            return None
        return halve(lin, g * float(Rg @ lin.z) / size, attempt, options.max_halvings, self.name)[0]

"""Gauss-Newton over the singular directions above the noise floor, halved until it descends."""

from typing import Any

from sysid.solver.iterate import Attempt, Linearisation, Options, Step, halve


class GaussNewton:
    """gn: singular values below 1e4 eps max(size J) ||J|| count as zero."""

    name = "gn"

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        return halve(lin, lin.gauss_newton(lin.noise_floor), attempt, options.max_halvings, self.name)[0]

"""Automatic choice: the first of several methods that descends."""

from typing import Any

from sysid.iterate import Attempt, Linearisation, Options, Search, Step
from sysid.searches.adaptive_gauss_newton import AdaptiveGaussNewton
from sysid.searches.gauss_newton import GaussNewton
from sysid.searches.gradient import Gradient
from sysid.searches.levenberg_marquardt import LevenbergMarquardt


class Auto:
    """auto: at each iteration gn, lm, gna, gradient in this order; the first descent is taken."""

    name = "auto"

    def __init__(self) -> None:
        self._methods: tuple[Search, ...] = (GaussNewton(), LevenbergMarquardt(), AdaptiveGaussNewton(), Gradient())

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        for method in self._methods:
            step = method.step(lin, attempt, memory.setdefault(method.name, {}), options)
            if step is not None:
                return step
        return None

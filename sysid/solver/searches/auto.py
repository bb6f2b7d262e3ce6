"""Automatic choice: the first of several methods that descends."""

from dataclasses import replace
from typing import Any

from sysid.solver.iterate import SMALL, Attempt, Options, Search, Step
from sysid.solver.linearisation import Linearisation
from sysid.solver.searches.gauss_newton import AdaptiveGaussNewton, GaussNewton, LevenbergMarquardt
from sysid.solver.searches.gradient import Gradient

_HALVINGS = 2


class Auto:
    """auto: at each iteration gn, lm, gna, gradient in this order; the first step that lowers the loss is used."""

    name = "auto"

    def __init__(self) -> None:
        self._methods: tuple[Search, ...] = (GaussNewton(), LevenbergMarquardt(), AdaptiveGaussNewton(), Gradient())

    def step(self, lin: Linearisation, attempt: Attempt, memory: dict[str, Any], options: Options) -> Step | None:
        for method in self._methods:
            # A Gauss-Newton step that is halved often goes in poorly determined directions; lm is better there.
            limits = replace(options, max_halvings=_HALVINGS) if method.name == "gn" else options
            step = method.step(lin, attempt, memory.setdefault(method.name, {}), limits)
            if step is not None:
                return step
            if method.name == "lm" and lin.expected_improvement <= SMALL:
                return None  # not worth the last resorts
        return None

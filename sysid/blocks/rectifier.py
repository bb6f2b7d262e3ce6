"""Rectifier: the absolute value, as a sensor that is blind to sign reads it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Map
from sysid.block.symmetry import Symmetry


def value(x, p):
    return abs(x) + p.zero


@checked
@dataclass(frozen=True)
class Rectifier(Map):
    """y = |x| + zero. The derivative at x = 0 is 0."""

    functions: ClassVar = {"value": value}

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("zero"),)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(1)

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        return [Symmetry(theta.copy(), in_scale=1.0, out_scale=1.0), Symmetry(np.ones(1), out_shift=1.0)]

"""Bowed gain: an odd gain that changes with the size of its input."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Map
from sysid.block.symmetry import Symmetry


def value(x, p):
    return x * (1.0 + p.bow * abs(x))


@checked
@dataclass(frozen=True)
class BowedGain(Map):
    """y = x (1 + bow |x|): the gain is 1 at x = 0, and grows for a positive bow, alike for both signs."""

    functions: ClassVar = {"value": value}

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("bow"),)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(1)

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        return [Symmetry(-theta, in_scale=1.0, out_scale=1.0)]

"""Steps of a driver: what a pulse-width modulator makes of a command, or a converter of a signal."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.block import Slot
from sysid.errors import InputError
from sysid.model.compiler.recursion import Map
from sysid.model.step import floor


def value(x, p, block):
    return block.step * floor(x / block.step + 0.5)


@dataclass(frozen=True)
class Quantiser(Map):
    """y = the multiple of `step` that is nearest to x, the upper one of two. Has no parameters: steps are known.

    A joint integrates what its driver leaves out, for as long as a command stands. Its derivative is zero, so it
    belongs before whatever is fitted.
    """

    functions: ClassVar = {"value": value}

    step: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.step < np.inf:
            raise InputError(f"step is {self.step}; give the driver's step, a positive number in the unit of the input")

    def slots(self) -> tuple[Slot, ...]:
        return ()

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.empty(0)

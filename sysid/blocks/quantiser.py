"""Quantiser, for example of a pulse-width modulator or an analogue-to-digital converter."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Map
from sysid.block.step import floor


def value(x, p, block):
    return block.step * floor(x / block.step + 0.5)


@checked
@dataclass(frozen=True)
class Quantiser(Map):
    """y = the multiple of `step` that is nearest to x, the upper one of two.

    It has no parameters, because the step is known. A joint integrates the rounding error of its driver while a command
    is constant. The derivative is zero, so place it before all fitted blocks.
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

"""Steps of a driver: what a pulse-width modulator makes of a command, or a converter of a signal."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Slot, StaticBlock


@dataclass(frozen=True)
class Quantiser(StaticBlock):
    """y = the multiple of `step` that is nearest to x, the upper one of two. Has no parameters: steps are known.

    A joint integrates what its driver leaves out, for as long as a command stands. Its derivative is zero, so it
    belongs before whatever is fitted.
    """

    step: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.step < np.inf:
            raise InputError(f"step is {self.step}; give the driver's step, a positive number in the unit of the input")

    def slots(self) -> tuple[Slot, ...]:
        return ()

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        return self.step * np.floor(x / self.step + 0.5), np.zeros_like(x)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.empty(0)

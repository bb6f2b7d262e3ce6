"""Transport delay with a fractional part."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Piecewise, Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.step import ago, floor
from sysid.block.symmetry import Symmetry

LONGEST = 1000.0  # samples


def step(s, x, p):
    whole = int(floor(p.delay))
    late = p.delay - whole
    return (1.0 - late) * ago(x, whole) + late * ago(x, whole + 1)


@checked
@dataclass(frozen=True)
class Delay(Recursion):
    """y at time t - delay [samples], by linear interpolation; before the record the first sample holds.

    For slow signals only: a zero-order-hold input jumps and is not linear between samples; use the delay of `Motor`
    for it. The derivative at a whole number of samples is that of a longer delay.
    """

    functions: ClassVar = {"step": step}

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("delay", "samples", lower=0.0, upper=LONGEST),)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(1)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(0.0 <= theta[0] <= LONGEST)

    def piecewise(self, theta: np.ndarray, q: int, P: int) -> Piecewise | None:
        """With as many samples before each piece as the delay reaches back."""
        history, tangent = np.empty(0), np.empty((0, q if P else 0))
        reach = int(theta[0]) + 2

        def run(x: np.ndarray, J: np.ndarray) -> np.ndarray:
            nonlocal history, tangent
            late, wide = np.concatenate([history, x]), np.empty((len(history) + len(x), P))
            wide[: len(history), : tangent.shape[1]], wide[len(history) :] = tangent, J
            n, tangent = len(history), np.concatenate([tangent, J[:, : tangent.shape[1]]])[-reach:]
            history = late[-reach:]
            y = self.propagate(theta, late, wide, q)
            J[:] = wide[n:]
            return y[n:]

        return run

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        still = np.zeros(1)
        return [Symmetry(still, in_scale=1.0, out_scale=1.0), Symmetry(still, in_shift=1.0, out_shift=1.0)]

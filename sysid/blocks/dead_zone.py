"""Dead zone with unit slope outside: zero between lower and upper."""

from dataclasses import dataclass

import numpy as np

from sysid.block.block import Slot, StaticBlock, Symmetry


@dataclass(frozen=True)
class DeadZone(StaticBlock):
    """y = x - lower below `lower`, x - upper above `upper`, 0 between; two parameters.

    The derivative at a break point is one-sided (zero).
    """

    def slots(self) -> tuple[Slot, ...]:
        return Slot("lower"), Slot("upper")

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        below, above = x < theta[0], x > theta[1]
        if J.shape[1]:
            J[:, q], J[:, q + 1] = -1.0 * below, -1.0 * above
        return x - np.clip(x, theta[0], theta[1]), np.where(below | above, 1.0, 0.0)

    def start(self, x: np.ndarray) -> np.ndarray:
        return 0.05 * (x.max() - x.min()) * np.array([-1.0, 1.0])

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        return [Symmetry(theta.copy(), in_scale=1.0, out_scale=1.0), Symmetry(np.ones(2), in_shift=1.0)]

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] < theta[1])

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return theta.mean() + 0.5 * (theta[1] - theta[0]) * np.array([-1.0, 1.0]) * rng.uniform(0.2, 4.0, 2)

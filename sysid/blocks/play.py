"""Play (backlash): the output follows once the input has crossed the width."""

from dataclasses import dataclass

import numpy as np

from sysid.block.block import Block, Slot


@dataclass(frozen=True)
class Play(Block):
    """y stays while x - width / 2 <= y <= x + width / 2 and is carried along at either side.

    `rest` says where in the play the output starts, from -1/2 to 1/2. The derivative at a reversal is that of the
    branch taken. What is behind has no inertia here; where it has, see `CoastingPlay`.
    """

    def slots(self) -> tuple[Slot, ...]:
        return Slot("width", lower=0.0), Slot("rest", lower=-0.5, upper=0.5, initial=True)

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        from sysid.block.kernels_play import play

        y = np.empty_like(x)
        play(float(theta[0]), float(theta[1]), x, y, J, q if J.shape[1] else 0)
        return y

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(self.n_parameters)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] >= 0.0)

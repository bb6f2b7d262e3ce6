"""Play (backlash): the output follows once the input has crossed the width."""

from dataclasses import dataclass

import numpy as np

from sysid.block import Block, Slot


@dataclass(frozen=True)
class Play(Block):
    """y stays while x - width / 2 <= y <= x + width / 2 and is carried along at either side.

    `rest` says where in the play the output starts, from -1/2 to 1/2. With `sided` a load presses the output against
    one side: s = side0 + side1 x in units of the friction that holds it. Up to |s| = 1 it stays where it is left, from
    2 on it lies on that side, between the room shrinks. The derivative at a reversal is that of the branch taken.
    """

    sided: bool = False

    def slots(self) -> tuple[Slot, ...]:
        own = (Slot("width", lower=0.0), Slot("rest", lower=-0.5, upper=0.5, initial=True))
        return (*own, Slot("side0"), Slot("side1")) if self.sided else own

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        from sysid.kernels_motion import play

        y = np.empty_like(x)
        side = theta[2:4] if self.sided else np.zeros(2)
        play(float(theta[0]), float(theta[1]), side, x, y, J, q if J.shape[1] else 0, self.sided)
        return y

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(self.n_parameters)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] >= 0.0)

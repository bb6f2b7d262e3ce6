"""Play of a link with inertia: it coasts where the drive slows down, and lies where its weight pulls."""

from dataclasses import dataclass

import numpy as np

from sysid.block.block import Block, Slot


@dataclass(frozen=True)
class CoastingPlay(Block):
    """y lies within x - width / 2 and x + width / 2; between the two it flies: v' = -(pull0 + pull1 y) - drag sign v.

    x moves evenly from sample to sample, and a link that meets a side goes on with it (no rebound). drag [y/sample^2]
    is the friction of the link's own bearing over its inertia, pull0 [y/sample^2] and pull1 [1/sample^2] its weight.
    With much drag and no pull this is `Play`. With little, a drive that stops finds the link ahead and not behind; with
    a pull that nothing overcomes the link lies on one side, and the width is not in the data. `rest` says where in the
    play it starts, at rest, from -1/2 to 1/2. Derivatives at a switch are those of the branch taken.
    """

    def slots(self) -> tuple[Slot, ...]:
        return (
            Slot("width", lower=0.0),
            Slot("rest", lower=-0.5, upper=0.5, initial=True),
            Slot("drag", "y/sample^2", lower=0.0),
            Slot("pull0", "y/sample^2"),
            Slot("pull1", "1/sample^2"),
        )

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        from sysid.block.kernels_play import coasting_play

        y = np.empty_like(x)
        width, rest, drag, pull0, pull1 = (float(value) for value in theta)
        coasting_play(width, rest, drag, pull0, pull1, x, y, J, q if J.shape[1] else 0)
        return y

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(self.n_parameters)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] >= 0.0 and theta[2] >= 0.0)

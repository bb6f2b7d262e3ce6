"""One-dimensional polynomial, highest power first."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Slot, StaticBlock, Symmetry


@dataclass(frozen=True)
class Polynomial(StaticBlock):
    """y = c1 x^n + ... + cn x + c(n+1). Grows fast outside the data: prefer knots where a model must extrapolate."""

    degree: int = 3

    def __post_init__(self) -> None:
        if self.degree < 1:
            raise InputError(f"a polynomial of degree {self.degree} is no map; give a degree of at least 1")

    def slots(self) -> tuple[Slot, ...]:
        return tuple(Slot(f"c{i + 1}") for i in range(self.degree + 1))

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        if J.shape[1]:
            J[:, q : q + self.degree + 1] = np.vander(x, self.degree + 1)
        return np.polyval(theta, x), np.polyval(np.polyder(theta), x)

    def start(self, x: np.ndarray) -> np.ndarray:
        theta = np.zeros(self.degree + 1)
        theta[-2] = 1.0
        return theta

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        powers = np.arange(self.degree, -1, -1)
        shift = np.zeros_like(theta)
        shift[1:] = -theta[:-1] * powers[:-1]  # p(x + eps) = p(x) + eps p'(x)
        constant = np.zeros_like(theta)
        constant[-1] = 1.0
        return [
            Symmetry(-powers * theta, in_scale=1.0),
            Symmetry(shift, in_shift=1.0),
            Symmetry(theta.copy(), out_scale=1.0),
            Symmetry(constant, out_shift=1.0),
        ]

"""One-dimensional polynomial, highest power first."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer
from sysid.blocks._shape import Shape


def value(x, p, block):
    y = 0.0
    for i in range(block.degree + 1):
        y = y * x + p.c[i]
    return y


@checked
@dataclass(frozen=True)
class Polynomial(Shape):
    """y = c1 x^n + ... + cn x + c(n+1).

    It grows fast outside the data; use a map with knots if the model must extrapolate.
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    degree: int = 3

    def __post_init__(self) -> None:
        if self.degree < 1:
            raise InputError(f"the degree of a polynomial is {self.degree}; give a degree of at least 1")

    @property
    def words(self) -> str:
        """What it is called: by its degree."""
        names = {1: "a straight line", 2: "a parabola", 3: "a cubic"}
        return names.get(self.degree, f"a polynomial of degree {self.degree}")

    def slots(self) -> tuple[Slot, ...]:
        return tuple(Slot(f"c{i + 1}") for i in range(self.degree + 1))

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        powers = ["" if k == 0 else w.x if k == 1 else f"{w.x}^{k}" for k in range(self.degree, -1, -1)]
        return [f"{w.y} = {w.sum(list(zip(theta.tolist(), powers, strict=True)))}"]

    def start(self, x: np.ndarray) -> np.ndarray:
        theta = np.zeros(self.degree + 1)
        theta[-2] = 1.0
        return theta

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        return Law(self, np.diag(b[0] / a[0] ** np.arange(self.degree, -1.0, -1.0)))

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

"""Saturation with unit slope: y = clip(x, lower, upper)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Law, Slot
from sysid.block.symmetry import Symmetry, diagonal
from sysid.blocks._shape import Shape


def value(x, p):
    return min(max(x, p.lower), p.upper)


@checked
@dataclass(frozen=True)
class Saturation(Shape):
    """y = min(max(x, lower), upper); two parameters, slope one between them.

    The derivative at a break point is one-sided (that of the linear part). If no sample passes a limit, the data do
    not determine it and its column of the Jacobian is zero.
    """

    functions: ClassVar = {"value": value}

    def slots(self) -> tuple[Slot, ...]:
        return Slot("lower"), Slot("upper")

    def start(self, x: np.ndarray) -> np.ndarray:
        # Inside the range, or both columns of the Jacobian would be zero and the limits would never move.
        lo, hi = float(x.min()), float(x.max())
        margin = 0.05 * (hi - lo)
        return np.array([lo + margin, hi - margin])

    def straight(self, x: np.ndarray) -> np.ndarray:
        lo, hi = float(x.min()), float(x.max())
        return np.array([lo - (hi - lo), hi + (hi - lo)])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        return Law(self, diagonal(a[0], 2, bool(a[0] < 0.0))) if a[0] == b[0] else None

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        return [
            Symmetry(theta.copy(), in_scale=1.0, out_scale=1.0),
            Symmetry(np.ones(2), in_shift=1.0, out_shift=1.0),
        ]

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] < theta[1])

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        middle, half = theta.mean(), 0.5 * (theta[1] - theta[0])
        return middle + half * np.array([-1.0, 1.0]) * rng.uniform(0.4, 1.0, 2)

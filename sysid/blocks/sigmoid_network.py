"""Sigmoid network: a line and a sum of sigmoids."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot
from sysid.block.compiler.recursion import Map
from sysid.block.step import logistic
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer


def value(x, p, block):
    y = p.y0 + p.L * x
    for k in range(block.units):
        y += p.s[k] * logistic(p.b[k] * x + p.c[k])
    return y


@checked
@dataclass(frozen=True)
class SigmoidNetwork(Map):
    """y = y0 + L x + sum_k s_k f(b_k x + c_k), f(z) = 1/(1 + e^-z), k = 1..units (10 by default).

    The toolbox's offset r of x is 0 here, because y0 and c_k include it.
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    units: int = 10

    def __post_init__(self) -> None:
        if self.units < 1:
            raise InputError(f"a sigmoid network has {self.units} units; give at least 1")

    def slots(self) -> tuple[Slot, ...]:
        n = range(1, self.units + 1)
        return (Slot("y0"), Slot("L"), *(Slot(f"{letter}{k}") for letter in "sbc" for k in n))

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        # By hand: the derived kernel takes 1.5 times as long over a unit's three columns.
        from sysid.block.kernels import sigmoid_network

        y, slope = np.empty_like(x), np.empty_like(x)
        sigmoid_network(theta, x, y, slope, J, q, J.shape[1] > 0)
        return y, slope

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        n = self.units
        rows = zip(theta[2 : 2 + n], theta[2 + n : 2 + 2 * n], theta[2 + 2 * n :], strict=True)
        units = [f"  + {w.num(s)}/(1 + exp(-({w.sum([(b, w.x), (c, '')])})))" for s, b, c in rows]
        return [f"{w.y} = {w.sum([(theta[0], ''), (theta[1], w.x)])}", *units]

    def start(self, x: np.ndarray) -> np.ndarray:
        """The line y = x, with the sigmoids spread over the range of x at weight zero."""
        lo, hi = float(x.min()), float(x.max())
        width = (hi - lo) / self.units if hi > lo else 1.0
        centre = lo + width * (np.arange(self.units) + 0.5)
        b = np.full(self.units, 4.0 / width)
        return np.concatenate([[0.0, 1.0], np.zeros(self.units), b, -b * centre])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        n = self.units
        return Law(self, np.diag(np.repeat([b[0], b[0] / a[0], b[0], 1.0 / a[0], 1.0], [1, 1, n, n, n])))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        n = self.units
        y0, L, s, b = theta[0], theta[1], theta[2 : 2 + n], theta[2 + n : 2 + 2 * n]
        zero = np.zeros(n)
        return [
            Symmetry(np.concatenate([[0.0, -L], zero, -b, zero]), in_scale=1.0),
            Symmetry(np.concatenate([[-L, 0.0], zero, zero, -b]), in_shift=1.0),
            Symmetry(np.concatenate([[y0, L], s, zero, zero]), out_scale=1.0),
            Symmetry(np.concatenate([[1.0, 0.0], zero, zero, zero]), out_shift=1.0),
        ]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        n = self.units
        fresh = theta.copy()
        stretch = np.exp(rng.uniform(-1.0, 1.0, n))
        fresh[2 + n : 2 + 2 * n] *= stretch
        fresh[2 + 2 * n :] *= stretch * rng.uniform(0.7, 1.3, n)
        return fresh

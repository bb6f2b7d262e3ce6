"""Maps of a few numbers that a fit may put in place of one of many break points."""

import re
from dataclasses import dataclass, field, replace
from typing import TypeGuard

import numpy as np

from sysid.block.block import Block, Slot, StaticBlock
from sysid.block.compiler.recursion import Map
from sysid.block.symmetry import Symmetry
from sysid.blocks.piecewise_linear import PiecewiseLinear


@dataclass(frozen=True)
class Shape(Map):
    """A map of a few numbers.

    `found`: the range of its signal in the record that named it, where a fit was asked for a piecewise linear map.
    """

    found: tuple[float, float] | None = field(default=None, kw_only=True)

    @property
    def words(self) -> str:
        """What people call it."""
        return "a " + re.sub(r"(?<!^)(?=[A-Z])", " ", type(self).__name__).lower()

    def asked(self) -> Block:
        return PiecewiseLinear(role=self.role) if self.found else self

    def finer(self, theta: np.ndarray, x: np.ndarray, knots: int) -> tuple[Block, np.ndarray] | None:
        lo, hi = float(x.min()), float(x.max())
        if not self.found or not lo < hi:
            return None
        places = np.linspace(lo, hi, knots)
        return PiecewiseLinear(free_knots=False, at=tuple(places.tolist()), role=self.role), self.output(theta, places)

    def wider(self, theta: np.ndarray) -> tuple[Block, np.ndarray, float] | None:
        if self.found is None:
            return None
        return Tailed(self, role=self.role), np.concatenate([[0.0], theta, [0.0]]), self.mean_slope(theta)

    def mean_slope(self, theta: np.ndarray) -> float:
        """Mean size of its slope over the range that the record has shown."""
        lo, hi = self.found or (-1.0, 1.0)
        return float(np.sum(np.abs(np.diff(self.output(theta, np.linspace(lo, hi, 50)))))) / (hi - lo)


def is_named(block: Block) -> TypeGuard[Shape]:
    """Whether a fit has put the block in place of a map of many break points."""
    return isinstance(block, Shape) and block.found is not None


@dataclass(frozen=True)
class Tailed(StaticBlock):
    """A named shape whose slope changes where the range ends that the record has shown: the first and last parameter.

    It is for the uncertainty of a fit, in which both are zero.
    """

    shape: Shape

    def slots(self) -> tuple[Slot, ...]:
        return Slot("below"), *self.shape.slots(), Slot("above")

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.pad(self.shape.start(x), 1)

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        y, slope = self.shape.evaluate(theta[1:-1], x, J, q + 1)
        below, above = self._tails(theta[1:-1], x, y)
        if J.shape[1]:
            J[:, q], J[:, q + len(theta) - 1] = below, above
        return y + theta[0] * below + theta[-1] * above, slope

    def _tails(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What a slope of 1 adds below and above the range: the way, and how far the shape bends from a line there."""
        ends = np.array(self.shape.found or (-np.inf, np.inf))
        values, slopes = self.shape.evaluate(theta, ends, np.empty((2, len(theta))), 0)
        mean = self.shape.mean_slope(theta) or 1.0
        beyond = (np.minimum(x - ends[0], 0.0), np.maximum(x - ends[1], 0.0))
        bent = [
            np.abs(y - v - s * (x - e)) * (way != 0.0)
            for v, s, e, way in zip(values, slopes, ends, beyond, strict=True)
        ]
        return beyond[0] - bent[0] / mean, beyond[1] + bent[1] / mean

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        inner = self.shape.symmetries(theta[1:-1])
        return [replace(s, d_theta=np.pad(s.d_theta, 1)) for s in inner]

    def slope_changes(self) -> np.ndarray:
        return np.eye(self.n_parameters)[[0, -1]]

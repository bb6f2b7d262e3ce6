"""Arrays of intervals in doubles, rounded outward: many boxes at once for a branch and bound."""

from __future__ import annotations

import numpy as np


class Boxes:
    """lo and hi (M,); every operation holds all results of its operands."""

    def __init__(self, lo: np.ndarray, hi: np.ndarray | None = None) -> None:
        self.lo, self.hi = lo, lo if hi is None else hi

    @staticmethod
    def _outward(lo: np.ndarray, hi: np.ndarray) -> Boxes:
        return Boxes(np.nextafter(lo, -np.inf), np.nextafter(hi, np.inf))

    def __add__(self, other: Boxes | float) -> Boxes:
        if isinstance(other, Boxes):
            return self._outward(self.lo + other.lo, self.hi + other.hi)
        return self._outward(self.lo + other, self.hi + other)

    __radd__ = __add__

    def __neg__(self) -> Boxes:
        return Boxes(-self.hi, -self.lo)

    def __sub__(self, other: Boxes | float) -> Boxes:
        return self + (-other)

    def __mul__(self, other: Boxes | float) -> Boxes:
        if not isinstance(other, Boxes):
            if other == 0:
                return Boxes(np.zeros_like(self.lo))
            a, b = self.lo * other, self.hi * other
            return self._outward(a, b) if other > 0 else self._outward(b, a)
        a, b, c, d = self.lo * other.lo, self.lo * other.hi, self.hi * other.lo, self.hi * other.hi
        low, high = np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d))
        return self._outward(low, high)

    __rmul__ = __mul__

    def __truediv__(self, other: float) -> Boxes:
        return self._outward(self.lo / other, self.hi / other)

    def __pow__(self, power: int) -> Boxes:
        low, high = np.minimum(np.abs(self.lo), np.abs(self.hi)), np.maximum(np.abs(self.lo), np.abs(self.hi))
        low = np.where((self.lo <= 0) & (self.hi >= 0), 0.0, low)
        return Boxes(np.maximum(np.nextafter(low * low, -np.inf), 0.0), np.nextafter(high * high, np.inf))


def slopes_of_boxes(x: Boxes, low: Boxes, high: Boxes) -> tuple:
    """Value of min(max(x, low), high) and its slopes, [0, 1] where a box lies on both sides of a kink."""
    value = Boxes(np.minimum(np.maximum(x.lo, low.lo), high.lo), np.minimum(np.maximum(x.hi, low.hi), high.hi))
    inside = (x.lo > low.hi) & (x.hi < high.lo)
    under, over = x.hi < low.lo, x.lo > high.hi
    maybe_under, maybe_over = x.lo <= low.hi, x.hi >= high.lo
    return (
        value,
        Boxes(inside.astype(float), (~under & ~over).astype(float)),
        Boxes(under.astype(float), (maybe_under & ~over).astype(float)),
        Boxes(over.astype(float), (maybe_over & ~under).astype(float)),
    )

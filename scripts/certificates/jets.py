"""Values with their first and second derivatives by parameter, over any numbers: mpf, intervals, arrays of intervals.

A derivative that is None is zero, which saves most of the work.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpmath import iv, mp

Number = Any


class KinkError(ArithmeticError):
    """A box has points on both sides of a kink, where no derivative exists."""


def plus(a: Number | None, b: Number | None) -> Number | None:
    """a + b, where None is zero."""
    return b if a is None else a if b is None else a + b


def times(a: Number | None, b: Number | None) -> Number | None:
    """a b, where None is zero."""
    return None if a is None or b is None else a * b


@dataclass
class Jet:
    """value, gradient (n,) and the rows of the lower triangle of the Hessian, or None without one."""

    value: Number
    gradient: list[Number | None]
    hessian: list[list[Number | None]] | None

    def __add__(self, other: Jet | Number) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.gradient, self.hessian)
        gradient = [plus(a, b) for a, b in zip(self.gradient, other.gradient, strict=True)]
        hessian = None
        if self.hessian is not None:
            pairs = zip(self.hessian, other.hessian, strict=True)
            hessian = [[plus(a, b) for a, b in zip(r, s, strict=True)] for r, s in pairs]
        return Jet(self.value + other.value, gradient, hessian)

    def scaled(self, factor: Number) -> Jet:
        """A multiple by a number without derivatives."""
        hessian = None if self.hessian is None else [[times(a, factor) for a in row] for row in self.hessian]
        return Jet(self.value * factor, [times(a, factor) for a in self.gradient], hessian)

    def __sub__(self, other: Jet | Number) -> Jet:
        return self + (other.scaled(-1) if isinstance(other, Jet) else -other)

    def __mul__(self, other: Jet | Number) -> Jet:
        if not isinstance(other, Jet):
            return self.scaled(other)
        a, b, g, h = self.value, other.value, self.gradient, other.gradient
        gradient = [plus(times(a, y), times(x, b)) for x, y in zip(g, h, strict=True)]
        hessian = None
        if self.hessian is not None:
            hessian = [
                [
                    plus(
                        plus(times(a, other.hessian[i][j]), times(self.hessian[i][j], b)),
                        plus(times(g[i], h[j]), times(g[j], h[i])),
                    )
                    for j in range(i + 1)
                ]
                for i in range(len(g))
            ]
        return Jet(a * b, gradient, hessian)

    def through(self, value: Number, first: Number, second: Number) -> Jet:
        """f of this jet, from f, f' and f'' at its value."""
        g = self.gradient
        hessian = None
        if self.hessian is not None:
            hessian = [
                [plus(times(first, self.hessian[i][j]), times(second, times(g[i], g[j]))) for j in range(i + 1)]
                for i in range(len(g))
            ]
        return Jet(value, [times(first, x) for x in g], hessian)

    def inverse(self) -> Jet:
        """1 over it."""
        one = 1 / self.value
        return self.through(one, -(one**2), one**3 * 2)

    def exp(self) -> Jet:
        """e to it."""
        value = _functions(self.value).exp(self.value)
        return self.through(value, value, value)

    def log(self) -> Jet:
        """Its natural logarithm."""
        one = 1 / self.value
        return self.through(_functions(self.value).log(self.value), one, -(one**2))

    def sign(self) -> int:
        """1, 0 or -1; raises `KinkError` for an interval that has several signs."""
        low, high = (self.value.a, self.value.b) if hasattr(self.value, "delta") else (self.value, self.value)
        if low > 0 or high < 0 or low == high == 0:
            return 1 if low > 0 else -1 if high < 0 else 0
        raise KinkError("a speed or a force may have either sign")

    def square(self) -> Jet:
        """The square, which for an interval is tighter than the product with itself."""
        a, g = self.value, self.gradient
        gradient = [times(a, x) if x is None else times(a, x) * 2 for x in g]
        hessian = None
        if self.hessian is not None:
            hessian = [
                [_twice(plus(times(a, self.hessian[i][j]), times(g[i], g[j]))) for j in range(i + 1)]
                for i in range(len(g))
            ]
        return Jet(a**2, gradient, hessian)


def _functions(value: Number) -> Any:
    """The module that has exp and log of a kind of number."""
    return math if isinstance(value, float) else iv if hasattr(value, "delta") else mp


def _twice(a: Number | None) -> Number | None:
    return None if a is None else a * 2


def parameters(values: list[Number], second: bool = True) -> list[Jet]:
    """The parameters themselves as jets."""
    n = len(values)
    one = [[values[k] * 0 + 1 if i == k else None for i in range(n)] for k in range(n)]
    return [
        Jet(v, g, [[None] * (i + 1) for i in range(n)] if second else None) for v, g in zip(values, one, strict=True)
    ]


def constant(value: Number, like: Jet) -> Jet:
    """A number as a jet."""
    n = len(like.gradient)
    return Jet(value, [None] * n, None if like.hessian is None else [[None] * (i + 1) for i in range(n)])


Slopes = Callable[[Number, Number, Number], tuple[Number, Number, Number, Number]]


def clip(x: Jet, low: Jet, high: Jet, slopes: Slopes) -> Jet:
    """min(max(x, low), high); `slopes` gives its value and its derivatives by x, low and high for a kind of number."""
    value, *weights = slopes(x.value, low.value, high.value)
    parts = [part.scaled(w) for part, w in zip((x, low, high), weights, strict=True) if w is not None]
    result = parts[0]
    for part in parts[1:]:
        result = result + part
    return Jet(value, result.gradient, result.hessian)


def slopes_of_reals(x: Number, low: Number, high: Number) -> tuple:
    """For numbers that can be compared."""
    return (low, None, 1, None) if x < low else (high, None, None, 1) if x > high else (x, 1, None, None)


def slopes_of_intervals(x: Number, low: Number, high: Number) -> tuple:
    """For mpmath's intervals; raises `KinkError` where a branch is not certain."""
    if x.b < low.a:
        return low, None, 1, None
    if x.a > high.b:
        return high, None, None, 1
    if x.a > low.b and x.b < high.a:
        return x, 1, None, None
    raise KinkError("a sample may lie on either side of a limit")

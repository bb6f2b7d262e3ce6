"""Numbers that carry their derivatives: a formula written once gives both (forward differentiation)."""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

_SLOPES: dict[Any, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {  # of the function, from its argument and value
    np.exp: lambda x, y: y,
    np.sqrt: lambda x, y: 0.5 / y,
    np.sin: lambda x, y: np.cos(x),
    np.cos: lambda x, y: -np.sin(x),
}
_PLAIN = {np.add: operator.add, np.subtract: operator.sub, np.multiply: operator.mul, np.true_divide: operator.truediv}


class Dual:
    """A value (m,) and its derivatives (p, m); m may be 1. It is compared by a value of one number."""

    def __init__(self, value: Any, slopes: Any) -> None:
        self.value, self.slopes = np.atleast_1d(np.asarray(value, dtype=float)), np.asarray(slopes, dtype=float)

    def __array_ufunc__(self, function: Any, method: str, *given: Any) -> "Dual":
        """A function of numpy, or its arithmetic with a number of numpy on the left."""
        if function in _PLAIN:
            first, second = given
            return _PLAIN[function](first if isinstance(first, Dual) else Dual(first, 0.0 * self.slopes), second)
        y = function(self.value)
        return Dual(y, _SLOPES[function](self.value, y) * self.slopes)

    def __add__(self, other: Any) -> "Dual":
        v, d = _parts(other)
        return Dual(self.value + v, self.slopes + d)

    def __mul__(self, other: Any) -> "Dual":
        v, d = _parts(other)
        return Dual(self.value * v, self.slopes * v + self.value * d)

    def __truediv__(self, other: Any) -> "Dual":
        v, d = _parts(other)
        return Dual(self.value / v, (self.slopes - self.value / v * d) / v)

    def __rtruediv__(self, other: Any) -> "Dual":
        return Dual(other / self.value, -other / self.value**2 * self.slopes)

    def __neg__(self) -> "Dual":
        return Dual(-self.value, -self.slopes)

    def __sub__(self, other: Any) -> "Dual":
        return self + -other

    def __rsub__(self, other: Any) -> "Dual":
        return -self + other

    __radd__, __rmul__ = __add__, __mul__

    def __abs__(self) -> "Dual":
        return -self if self < 0.0 else self

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < _parts(other)[0])

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > _parts(other)[0])


def _parts(x: Any) -> tuple[Any, Any]:
    return (x.value, x.slopes) if isinstance(x, Dual) else (x, 0.0)

"""The functions that a step may call, as plain Python, so that a step also runs uncompiled, but slowly."""

import math
from math import cos, exp, log, sin, sqrt, tanh

__all__ = ["Input", "ago", "cos", "exp", "floor", "log", "logistic", "sign", "sin", "sqrt", "tanh"]


class Input(float):
    """One sample of an input, with access to the previous samples."""

    past: tuple[float, ...] = ()  # the sample before first

    @classmethod
    def at(cls, x: list[float], t: int) -> "Input":
        """Sample t of x (N,)."""
        found = cls(x[t])
        found.past = tuple(x[t - 1 :: -1]) if t else ()
        return found


def ago(x: float, n: int) -> float:
    """The input n samples ago; before the record its first sample."""
    if n == 0:
        return float(x)
    past = x.past if isinstance(x, Input) else ()
    return past[min(n, len(past)) - 1] if past else float(x)


def floor(x: float) -> float:
    """The largest whole number not above x, as a float."""
    return float(math.floor(x))


def logistic(x: float) -> float:
    """1 / (1 + e^-x), at any x."""
    return 1.0 / (1.0 + exp(-x)) if x > -700.0 else 0.0


def sign(x: float) -> float:
    """1, 0 or -1."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)

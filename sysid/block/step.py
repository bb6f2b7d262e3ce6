"""What a step may call and Python's math lacks, as plain Python, so that a step also runs uncompiled, but slowly.

The last two are the exact solution of a first-order lag towards a speed, which the motors share.
"""

import math
from math import exp, log

_NEWTON_STEP = 1e-9  # of the time; the Newton step that is as small leaves an error of its square


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


def advance_lag(s, target, lag, way, h, decay):
    """Advance position and speed by a time h, or until the speed in direction `way` passes zero; decay is e^(-h / lag).

    Returns the elapsed time, and whether it ended at a reversal.
    """
    off = s.speed - target
    after = target + off * decay
    turns = s.speed != 0.0 and after * way < 0.0
    span = h
    if turns:
        span = lag * log(1.0 - s.speed / target)
        decay = target / (target - s.speed)
        after = 0.0
    s.position += target * span + off * (lag * (1.0 - decay))
    s.speed = after
    return span, turns


def time_to_reach(speed, target, lag, way, far, h):
    """Time within h at which a lag from `speed` towards a target has gone `far` in direction `way`, and its speed then.

    Without a reversal the way bends to one side only: Newton's method never overshoots from the start where the lag
    brakes, and from the end where it speeds up. Its last step makes the derivative exact.
    """
    off = speed - target
    t = 0.0 if off * way >= 0.0 or far * way <= 0.0 else h
    for _ in range(60):  # six are usual; many where the lag is far shorter than h
        decay = exp(-t / lag)
        now = target + off * decay
        if now * way <= 0.0 or far * way <= 0.0:
            break
        error = (target * t + off * (lag * (1.0 - decay)) - far) / now
        t -= error
        if abs(error) <= _NEWTON_STEP * h:
            break
    return t, target + off * exp(-t / lag)

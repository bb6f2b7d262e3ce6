"""The exact solution of a first-order lag towards a speed, shared by the motors."""

from math import exp, log


def lagged(s, target, lag, way, h):
    """Advance position and speed by a time h, or until the speed in direction `way` passes zero.

    Returns the elapsed time, and whether it ended at a reversal.
    """
    decay = exp(-h / lag)
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

"""The stretch that motors share: a first-order lag towards a speed, taken exactly."""

from math import exp, log


def lagged(s, target, lag, way, h):
    """Move position and speed on over a time h, or up to the turn where the speed passes zero on the way `way`.

    Returns the time that has passed, and whether it ended at a turn.
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

"""The exact solution of a first-order lag towards a speed, shared by the motors."""

from math import exp, log

_CLOSE = 1e-9  # of the time; the Newton step that is as small leaves an error of its square


def lagged(s, target, lag, way, h, decay):
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


def reached(speed, target, lag, way, far, h):
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
        if abs(error) <= _CLOSE * h:
            break
    return t, target + off * exp(-t / lag)

"""How far a designed course may go: stops that the first record shows, else the range that it shows."""

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.evidence import stop_tests
from sysid.joint.value_physics import travel_of

_UNSEEN = 0.3  # of the way seen: how far outside a stop may be that the joint may run into


def falling(fit: Fit) -> bool:
    """Whether the output falls as the motor's position rises."""
    travel = travel_of(fit.model)
    if travel is None:
        return False
    low, high = fit.model.part(fit.theta, travel)[:2]
    return bool(high < low)


def stops_met(fit: Fit, data: IOData) -> dict[int, bool]:
    """Whether the record shows a stop, by the motor's way."""
    shown, falls = stop_tests(fit, data), falling(fit)
    lower, upper = (name in shown and shown[name].met for name in ("end_low", "end_high"))
    return {-1: upper, 1: lower} if falls else {-1: lower, 1: upper}


def end_of(fit: Fit, way: int, seen: np.ndarray, met: bool, to_stops: bool) -> float:
    """Position of the motor up to which the course is planned."""
    motor = motor_of(fit.model)
    name = "upper" if way > 0 else "lower"
    stop = motor.value(fit.model.part(fit.theta, motor), name) if name in motor.ends else way * np.inf
    farthest, whole = way * float((way * seen).max()), float(np.ptp(seen))
    if met or (to_stops and 0.0 <= way * (stop - farthest) <= _UNSEEN * whole):
        return float(stop)
    return farthest + way * (_UNSEEN * whole if to_stops else 0.0)

"""Physics of an identified joint over its travel: ends, and the voltage that starts it at a place."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from sysid.blocks import Travel
from sysid.blocks.motor import lost_of
from sysid.estimation.joint_parts import motor_of
from sysid.model.chain import Chain

_LARGEST_INPUT = 1e3  # [V] within which a driver is inverted
_FARTHEST_STOP = 100.0  # strokes: a stop beyond is none
_MAP_PLACES = 401  # of a travel map that is inverted


def travel_of(chain: Chain) -> Travel | None:
    """The chain's travel map, if it has one."""
    return next((b for b in chain.blocks if isinstance(b, Travel)), None)


def ends_of(chain: Chain, theta: np.ndarray) -> tuple[float, float]:
    """Lower and upper end of a joint's stops in units of y; infinite where it has none, or one out of reach."""
    motor, travel = motor_of(chain), travel_of(chain)
    part = chain.part(theta, motor)
    low, high = (motor.value(part, name) if name in motor.ends else np.inf for name in ("lower", "upper"))
    if travel is None:
        return (low if np.isfinite(low) else -np.inf), high
    shape = chain.part(theta, travel)
    angles = [float(travel.output(shape, np.array([x]))[0]) if abs(x) < _FARTHEST_STOP else np.nan for x in (low, high)]
    if shape[1] < shape[0]:
        angles.reverse()
    return (-np.inf if np.isnan(angles[0]) else angles[0]), (np.inf if np.isnan(angles[1]) else angles[1])


def slope_of(chain: Chain, theta: np.ndarray) -> float:
    """Way of y per stroke of the motor, over the middle fifth of the travel; 1 without a travel map."""
    travel = travel_of(chain)
    if travel is None:
        return 1.0
    ends = travel.output(chain.part(theta, travel), np.array([0.4, 0.6]))
    return float(ends[1] - ends[0]) / 0.2


def way_up(chain: Chain, theta: np.ndarray) -> int:
    """The motor's way, 1 or -1, under which the output rises: -1 with a reversed sensor."""
    return 1 if slope_of(chain, theta) > 0.0 else -1


def volts_to_move(chain: Chain, theta: np.ndarray, direction: int, static: bool, place: float | None = None) -> float:
    """Input [V] for friction and load in a direction of the motor, at its position `place` (None: mid stroke)."""
    motor = motor_of(chain)
    part = chain.part(theta, motor)
    p, (load, hold) = motor.named(part), motor.borne(part, motor.at if place is None else place)
    stick = p.stick_down if motor.sided and direction < 0 else p.stick
    dry = (p.rise if direction > 0 else p.fall) + (stick if static else 0.0)
    return input_for_volts(chain, theta, load + direction * (dry + lost_of(load, hold, direction, p)))


def breakaway_over_place(chain: Chain, theta: np.ndarray) -> Callable[[float, int], float]:
    """Break-away input [V] as a function of the place [y] and of the direction of y, 1 or -1."""
    travel = travel_of(chain)
    if travel is None:
        return lambda place, way: volts_to_move(chain, theta, way, True, place)
    strokes = np.linspace(0.0, 1.0, _MAP_PLACES)
    angles = travel.output(chain.part(theta, travel), strokes)
    falls = angles[-1] < angles[0]
    if falls:
        strokes, angles = strokes[::-1], angles[::-1]

    def volts(place: float, way: int) -> float:
        return volts_to_move(chain, theta, -way if falls else way, True, float(np.interp(place, angles, strokes)))

    return volts


def input_for_volts(chain: Chain, theta: np.ndarray, volts: float) -> float:
    """Input [V] at which the driver's output is `volts`; nan if there is none."""
    driver = chain.block("driver")
    if driver is None:
        return volts

    def excess(u: float) -> float:
        return float(driver.output(chain.part(theta, driver), np.array([u]))[0]) - volts

    if excess(-_LARGEST_INPUT) * excess(_LARGEST_INPUT) > 0:
        return np.nan
    return float(brentq(excess, -_LARGEST_INPUT, _LARGEST_INPUT))

"""Physical values of an identified actuated joint: speeds, voltages, angles and times, with intervals."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, Play, TravelMap
from sysid.data.record import IOData
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.uncertainty.information import information

_LARGEST = 1e3  # [V] within which a driver is inverted
_STEP = 1e-6


@dataclass(frozen=True)
class JointValue:
    """A physical value with its interval; low and high are None where the data do not determine it."""

    name: str
    value: float
    low: float | None
    high: float | None
    unit: str

    def holds(self, truth: float) -> bool:
        """Whether the interval contains `truth`; False if there is no interval."""
        return self.low is not None and self.high is not None and self.low <= truth <= self.high


def joint_values(
    fit: Fit, level: float = 0.95, data: IOData | None = None, linearity: float = 0.0
) -> tuple[JointValue, ...]:
    """Physical values of an `actuated_joint`, at mid stroke if they depend on position.

    speed_per_volt [y/s/V], time_constant [s], breakaway_up and breakaway_down [V] (break-away voltage with load,
    static friction and the driver's dead zone), coulomb_up and coulomb_down [V] (voltage for friction and load in
    motion), end_low and end_high [y], backlash [y], delay [s]; y in the record's unit. Intervals by the delta method:
    from the covariance of the fit, which assumes white residuals, or, if the record `data` of the fit is given, from
    one that allows for coloured residuals (see `sysid.uncertainty.information`), for example if the model is
    incomplete. Intervals are symmetric and cut off at the limits of a value's range; a value at a limit (no backlash)
    or a fixed value has none. Without `stribeck` static and moving friction are equal.

    linearity [y]: largest deviation of the sensor from a straight line, from its data sheet. A record does not show
    the errors of its own sensor. They enter ends and speed as a deviation that oscillates between the two limits, with
    standard uncertainty linearity / sqrt(2) (arcsine distribution, as in JCGM 100:2008, annex H.1). Raises InputError
    for another structure, level or linearity.
    """
    chain = fit.model
    if not is_joint(chain):
        raise InputError(f"a {chain.structure} has no motor; joint values are those of an actuated_joint")
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a probability between 0 and 1, for example 0.95")
    if not 0.0 <= linearity < np.inf:
        raise InputError(
            f"linearity is {linearity}; give the largest deviation of the sensor from a straight line, 0 or more"
        )
    spread_of = _white(fit, level) if data is None else _coloured(fit, level, data)
    found = []
    for name, (unit, read, least) in _readings(chain, fit.Ts).items():
        value = read(fit.theta)
        if not np.isfinite(value):
            continue
        spread, low, high = spread_of(_gradient(read, fit.theta)), None, None
        if np.isfinite(spread) and spread > 0.0:
            off_line = linearity * _nonlinearity_share(name, value, chain, fit.theta)
            spread = float(np.hypot(spread, norm.ppf(0.5 + level / 2) * off_line))
            low, high = max(value - spread, least), value + spread
        found.append(JointValue(name, float(value), low, high, unit))
    return tuple(found)


def _nonlinearity_share(name: str, value: float, chain: Chain, theta: np.ndarray) -> float:
    """Standard uncertainty of a value for a sensor with a largest deviation of 1 from a straight line."""
    if name.startswith("end_"):
        return float(np.sqrt(0.5))
    travel = next((b for b in chain.blocks if isinstance(b, TravelMap)), None)
    if name != "speed_per_volt" or travel is None:
        return 0.0  # a play is a difference between readings at one place
    ends = _across_middle(travel, chain.part(theta, travel))
    return abs(value / ends)  # sqrt(2) times 1 / sqrt(2), over the way that the speed is read from


def _across_middle(travel: TravelMap, part: np.ndarray) -> float:
    """Range of y over the middle fifth of the stroke."""
    ends = travel.output(part, np.array([0.4, 0.6]))
    return float(ends[1] - ends[0])


def _white(fit: Fit, level: float) -> Callable[[np.ndarray], float]:
    """Half width of an interval from a gradient (P,); nan if it is undetermined."""
    factor = float(norm.ppf(0.5 + level / 2))
    covariance, known = fit.covariance.cov, np.isfinite(fit.covariance.std()) | ~fit.model.free

    def spread(gradient: np.ndarray) -> float:
        if np.any(np.abs(gradient[~known]) > 0.0):
            return np.nan
        return factor * float(np.sqrt(max(gradient[known] @ covariance[np.ix_(known, known)] @ gradient[known], 0.0)))

    return spread


def _coloured(fit: Fit, level: float, data: IOData) -> Callable[[np.ndarray], float]:
    info = information(fit, data, lags="auto")
    return lambda gradient: info.quantile(level) * float(info.std_of(gradient)[0])


Reading = tuple[str, Callable[[np.ndarray], float], float]


def _readings(chain: Chain, Ts: float) -> dict[str, Reading]:
    """Unit, function of theta, and smallest possible value of every quantity of the chain."""
    motor = motor_of(chain)
    travel = next((b for b in chain.blocks if isinstance(b, TravelMap)), None)
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)

    def of(name: str) -> Callable[[np.ndarray], float]:
        return lambda theta: motor.value(chain.part(theta, motor), name)

    def speed(theta: np.ndarray) -> float:
        slope = 1.0
        if travel is not None:
            slope = _across_middle(travel, chain.part(theta, travel)) / 0.2
        return of("gain")(theta) * slope / Ts

    def held(theta: np.ndarray, direction: int, static: bool) -> float:
        load = of("load0")(theta)  # of the motor's own `at`, mid stroke
        dry = of("rise" if direction > 0 else "fall")(theta)
        extra = of("stick")(theta) if static else 0.0
        volts = load + direction * (dry + extra + of("loss")(theta) * abs(load))
        return _through_driver(chain, theta, volts)

    found: dict[str, Reading] = {
        "speed_per_volt": ("y/s/V", speed, -np.inf),
        "time_constant": ("s", lambda theta: of("lag")(theta) * Ts, 0.0),
        "breakaway_up": ("V", lambda theta: held(theta, 1, True), -np.inf),
        "breakaway_down": ("V", lambda theta: held(theta, -1, True), -np.inf),
        "coulomb_up": ("V", lambda theta: held(theta, 1, False), -np.inf),
        "coulomb_down": ("V", lambda theta: held(theta, -1, False), -np.inf),
    }
    if travel is not None:
        found["end_low"] = ("y", lambda theta: float(chain.part(theta, travel)[:2].min()), -np.inf)
        found["end_high"] = ("y", lambda theta: float(chain.part(theta, travel)[:2].max()), -np.inf)
    elif motor.stops:
        found["end_low"], found["end_high"] = ("y", of("lower"), -np.inf), ("y", of("upper"), -np.inf)
    if play is not None:
        found["backlash"] = ("y", lambda theta: float(chain.part(theta, play)[0]), 0.0)
    if motor.delayed:
        found["delay"] = ("s", lambda theta: of("delay")(theta) * Ts, 0.0)
    return found


def _through_driver(chain: Chain, theta: np.ndarray, volts: float) -> float:
    """Input [V] at which the driver's output is `volts`; nan if there is none."""
    driver = chain.block("driver")
    if driver is None:
        return volts

    def excess(u: float) -> float:
        return float(driver.output(chain.part(theta, driver), np.array([u]))[0]) - volts

    if excess(-_LARGEST) * excess(_LARGEST) > 0:
        return np.nan
    return float(brentq(excess, -_LARGEST, _LARGEST))


def _gradient(read: Callable[[np.ndarray], float], theta: np.ndarray) -> np.ndarray:
    """Central differences (P,)."""
    out = np.zeros(len(theta))
    for i in range(len(theta)):
        step = np.zeros(len(theta))
        step[i] = _STEP * max(1.0, abs(theta[i])) if theta[i] == 0.0 else _STEP * abs(theta[i])
        out[i] = (read(theta + step) - read(theta - step)) / (2.0 * step[i])
    return out

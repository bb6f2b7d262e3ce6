"""Physical values of an identified actuated joint: speeds, voltages, angles and times, with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from sysid.base import quantities
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, Play, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.result import Fit
from sysid.joint.evidence import Evidence, ValueEvidence, evidence, spread_in_words
from sysid.joint.hidden_play import hidden_play
from sysid.joint.physics import ends_of, slope_of, travel_of, volts_to_move, way_up
from sysid.joint.spread import END_REACH, Spread, spread_of, structural_deviation, white_spread
from sysid.model.chain import Chain

_LARGEST_DEVIATION = 0.1  # of a speed, or of the dry friction: a wider standard uncertainty does not determine it

WORDS = {  # the physical values of an actuated joint as people call them
    "speed_per_volt": "speed per volt, mid stroke",
    "speed_full_drive": "speed at full drive",
    "kp": "gain of the loop, kp",
    "kd": "derivative gain of the loop, kd",
    "dead": "dead band around the goal",
    "time_constant": "time constant",
    "breakaway_up": "break-away voltage up",
    "breakaway_down": "break-away voltage down",
    "coulomb_up": "voltage for friction and load, moving up",
    "coulomb_down": "voltage for friction and load, moving down",
    "moving_friction_up": "moving friction up, with load",
    "moving_friction_down": "moving friction down, with load",
    "end_low": "lower end stop",
    "end_high": "upper end stop",
    "backlash": "backlash",
    "delay": "delay",
    "lag_and_delay": "time constant + delay",
}


@dataclass(frozen=True)
class JointValue:
    """A physical value with its interval; low and high are None where the data do not determine it, and the value where
    it was given.

    `determined`: whether the record bears the value; `why` says why not, or what shows it. Without a record there is
    only the information of the fit to judge by.
    """

    name: str
    value: float
    low: float | None
    high: float | None
    unit: str
    determined: bool = True
    why: str = ""

    def holds(self, truth: float) -> bool:
        """Whether the interval contains `truth`; False if there is no interval."""
        return self.low is not None and self.high is not None and self.low <= truth <= self.high

    def __str__(self) -> str:
        """Value, interval and unit as people read them."""
        shown = displayed_value(self)
        text, span = quantities.number(shown.value), ""
        if shown.low is not None and shown.high is not None:
            text, *ends = quantities.estimate(shown.value, shown.low, shown.high)
            span = f" ({' to '.join(ends)})"
        return f"{WORDS.get(self.name, self.name)}: {text}{span} {shown.unit}".rstrip()


@checked(late=True)
def joint_values(
    fit: Fit, level: float = 0.95, data: IOData | None = None, linearity: float = 0.0, complete: bool = False
) -> tuple[JointValue, ...]:
    """Physical values of an `actuated_joint`, at mid stroke if they depend on position.

    Up is where the output rises, whatever the sign of the voltage. speed_per_volt [y/s/V], time_constant [s],
    breakaway_up and breakaway_down [V] (break-away voltage with load, static friction and the driver's dead zone),
    coulomb_up and coulomb_down [V] (voltage for friction and load in motion), end_low and end_high [y] (where the drive
    meets its end stops: with backlash the output rests half of it inside where the drive pushes it there, and up to
    half of it beyond where it coasts on), backlash [y], delay [s]; y is the unit of the record where one is given.
    Without `stribeck` static and moving friction are equal.

    Intervals without a record are those of the delta method from the covariance of the fit, which assumes white
    residuals and a complete model. With the record `data` of the fit they allow for coloured residuals (see
    `sysid.uncertainty.information`), for structure that is left in them, and for what every model of a joint lacks (see
    `sysid.joint.spread`); `complete` leaves the last out, for a record of the model itself. A value that the
    record does not bear (see `sysid.joint.evidence`) then has no interval and says why: an end that was not met, a
    backlash that is not crossed. In place of a break-away without starts from rest there is moving_friction_up or
    moving_friction_down [V], and lag_and_delay [s] in place of a time constant and a delay that the record does not
    tell apart. A servo has speed_full_drive [y/s] in place of speed_per_volt, its gains kp [drive/y] and kd, a dead
    band [y] where the record shows one, and where its largest drive is 1, shares of full duty in place of volts. A
    break-away is drawn towards the voltages of those starts, and an end stays near the rests against it. Intervals are
    symmetric and cut off at the limits of a value's range; a value at a limit (no backlash) or a fixed value has none.

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
    readings = _readings(chain, fit.Ts, (data and data.y_unit) or "y")
    support, dry, hidden = None, 0.0, np.inf
    if data is None:
        plain = white_spread(fit, level)
        rows = {name: ValueEvidence(True) for name in readings}
    else:
        plain = spread_of(fit, data, level, halves=not complete)
        if complete:
            plain = replace(plain, lack=0.0)
        support = evidence(fit, data, plain)
        readings = _determined_readings(readings, support)
        dry = 0.5 * abs(readings["coulomb_up"][1](fit.theta) - readings["coulomb_down"][1](fit.theta))
        hidden = hidden_play(fit, data) if any(test.met for test in support.stops.values()) else np.inf
        rows = {name: _check_precision(name, _evidence_of(name, support), readings, plain, dry) for name in readings}
    way, factor = _stroke(chain, fit.theta, data), float(norm.ppf(0.5 + level / 2))
    values = []
    for name, (unit, read, least) in readings.items():
        value, row = read(fit.theta), rows[name]
        if not np.isfinite(value):
            continue
        if f"{motor_of(chain).role}.{name}" in chain.fixed:  # a gain that was given
            values.append(JointValue(name, float(value), float(value), float(value), unit))
            continue
        half = plain(read)
        if row.determined and not (np.isfinite(half) and half > 0.0):
            row = ValueEvidence(False, "the record has no information on it")
        if name == "dead" and not row.determined:  # one that may be 0 is a part that is open or absent
            continue
        limits: tuple[float | None, float | None] = (None, None)
        if row.determined:
            off_line, lacks = linearity * _nonlinearity_share(name, value, chain, fit.theta), 0.0
            if support is not None and not complete:
                friction = dry / readings["kp"][1](fit.theta) if name == "dead" else dry
                value, lacks = _record_correction(name, value, support, way, fit.Ts, friction)
                lacks = min(lacks, 0.5 * hidden) if name in support.stops else lacks
                lacks = float(np.hypot(lacks, _play_half_width(chain, fit.theta) if name in support.stops else 0.0))
                half = 0.0 if name in support.breakaway else half  # which the agreement with the starts includes
            half = float(np.sqrt(half**2 + (factor * off_line) ** 2 + (factor * lacks) ** 2))
            limits = max(value - half, least), value + half
        values.append(JointValue(name, float(value), *limits, unit, row.determined, row.why))
    return tuple(values)


def distinct_values(values: Sequence[JointValue]) -> list[JointValue]:
    """The values without the friction in motion of a way whose moving friction, the same number, is among them."""
    moving = {v.name.replace("moving_friction", "coulomb") for v in values}
    return [v for v in values if v.name not in moving or not v.name.startswith("coulomb")]


def displayed_value(value: JointValue) -> JointValue:
    """The value in the unit of tables, pictures and its own sentence `why`: degrees where the output is in radians."""
    quantity = quantities.display_quantity(value.name, value.unit)
    low, high = (None if limit is None else limit * quantity.factor for limit in (value.low, value.high))
    return replace(value, value=value.value * quantity.factor, low=low, high=high, unit=quantity.unit or value.unit)


def _record_correction(
    name: str, value: float, support: Evidence, way: float, Ts: float, dry: float
) -> tuple[float, float]:
    """A value with what the record shows of it directly, and its standard uncertainty beyond that of the fit."""
    if name in support.breakaway:
        return value + support.breakaway[name].shift, support.breakaway[name].std
    if name in support.stops:
        rests = float(np.mean([visit.reading for visit in support.stops[name].visits]))
        value = float(np.clip(value, rests - END_REACH * way, rests + END_REACH * way))
    return value, structural_deviation(name, value, way, Ts, dry)


def _play_half_width(chain: Chain, theta: np.ndarray) -> float:
    """By how much an end is uncertain since a link that coasts may rest on either side of its backlash [y]."""
    play = next((b for b in chain.blocks if isinstance(b, CoastingPlay)), None)
    return 0.0 if play is None else 0.5 * float(chain.part(theta, play)[0])


def _stroke(chain: Chain, theta: np.ndarray, data: IOData | None) -> float:
    """Way between the ends [y]; what was seen of it for a joint without two stops."""
    low, high = ends_of(chain, theta)
    if np.isfinite(high - low) or data is None:
        return high - low
    return max(float(np.ptp(record.y)) for record in data.experiments)


def _nonlinearity_share(name: str, value: float, chain: Chain, theta: np.ndarray) -> float:
    """Standard uncertainty of a value for a sensor with a largest deviation of 1 from a straight line."""
    if name.startswith("end_"):
        return float(np.sqrt(0.5))
    if name != "speed_per_volt" or travel_of(chain) is None:
        return 0.0  # a play is a difference between readings at one place
    return abs(
        value / (0.2 * slope_of(chain, theta))
    )  # sqrt(2) times 1 / sqrt(2), over the way that the speed is read from


Reading = tuple[str, Callable[[np.ndarray], float], float]


def _readings(chain: Chain, Ts: float, y: str) -> dict[str, Reading]:
    """Unit, function of theta, and smallest possible value of every quantity of the chain, whose output is in `y`."""
    motor = motor_of(chain)
    travel = travel_of(chain)
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)

    def of(name: str) -> Callable[[np.ndarray], float]:
        return lambda theta: motor.value(chain.part(theta, motor), name)

    def speed(theta: np.ndarray) -> float:
        return of("gain")(theta) * slope_of(chain, theta) / Ts

    def held(theta: np.ndarray, direction: int, static: bool) -> float:
        return volts_to_move(chain, theta, direction * way_up(chain, theta), static)

    servo = isinstance(motor, ServoMotor)
    volts = "duty" if servo and chain.fixed.get(f"{motor.role}.limit") == 1.0 else "V"
    readings: dict[str, Reading] = {
        "speed_per_volt": (quantities.rate(y, "s/V"), speed, -np.inf),
        "time_constant": ("s", lambda theta: of("lag")(theta) * Ts, 0.0),
        "breakaway_up": (volts, lambda theta: held(theta, 1, True), -np.inf),
        "breakaway_down": (volts, lambda theta: held(theta, -1, True), -np.inf),
        "coulomb_up": (volts, lambda theta: held(theta, 1, False), -np.inf),
        "coulomb_down": (volts, lambda theta: held(theta, -1, False), -np.inf),
    }
    if travel is not None and not chain.fixed.keys() >= {f"{travel.role}.low", f"{travel.role}.high"}:
        readings["end_low"] = (y, lambda theta: float(chain.part(theta, travel)[:2].min()), -np.inf)
        readings["end_high"] = (y, lambda theta: float(chain.part(theta, travel)[:2].max()), -np.inf)
    elif motor.stops:
        readings["end_low"] = (y, lambda theta: ends_of(chain, theta)[0], -np.inf)
        readings["end_high"] = (y, lambda theta: ends_of(chain, theta)[1], -np.inf)
    if play is not None:
        readings["backlash"] = (y, lambda theta: float(chain.part(theta, play)[0]), 0.0)
    if servo:
        del readings["speed_per_volt"]
        readings = {
            "speed_full_drive": (quantities.rate(y, "s"), lambda theta: speed(theta) * of("limit")(theta), -np.inf)
        } | readings
        readings["kp"] = (quantities.ratio(volts, y), of("kp"), 0.0)
        if f"{motor.role}.kd" in chain.names:
            readings["kd"] = (quantities.ratio(f"{volts} s", y), lambda theta: of("kd")(theta) * Ts, 0.0)
        if isinstance(motor, ServoMotor) and motor.dead:
            readings["dead"] = (y, of("dead"), 0.0)
    if motor.delayed:
        readings["delay"] = ("s", lambda theta: of("delay")(theta) * Ts, 0.0)
    return readings


def _determined_readings(readings: dict[str, Reading], support: Evidence) -> dict[str, Reading]:
    """The readings with moving friction in place of a break-away, and a sum in place of lag and delay, that the record
    does not determine."""
    determined = {}
    for name, reading in readings.items():
        if name.startswith("breakaway") and not support.determined(name):
            way = name.removeprefix("breakaway")
            determined[f"moving_friction{way}"] = readings[f"coulomb{way}"]
        elif name == "time_constant" and not support.determined(name):
            determined["lag_and_delay"] = _sum(reading, readings["delay"])
        elif name != "delay" or support.determined(name):
            determined[name] = reading
    return determined


def _evidence_of(name: str, support: Evidence) -> ValueEvidence:
    """Whether a reading is determined, and why."""
    if name.startswith("moving_friction"):
        breakaway_reason = support.why(name.replace("moving_friction", "breakaway"))
        return ValueEvidence(True, f"break-away is not determined: {breakaway_reason}")
    if name == "lag_and_delay":
        return ValueEvidence(True, support.why("delay"))
    return ValueEvidence(support.determined(name), support.why(name))


def _check_precision(
    name: str, row: ValueEvidence, readings: dict[str, Reading], spread: Spread, dry: float
) -> ValueEvidence:
    """The row of a speed or of a friction in motion, not determined where its standard uncertainty is too large.

    A load may make the voltage that moves a joint as small as one likes, so it is compared with the dry friction.
    """
    volts = name.startswith(("coulomb", "moving_friction"))
    if not row.determined or not (volts or name.startswith(("speed", "dead"))):
        return row
    read = readings[name][1]
    std, least = spread.std(read), dry if volts else abs(read(spread.noise.theta))
    if not std > _LARGEST_DEVIATION * least:
        return row
    servo = "speed_full_drive" in readings
    reason = f"uncertain by {spread_in_words(std / max(least, 1e-300))}{f', {row.why}' if row.why else ''}"
    if servo and volts and np.isfinite(std) and least <= 2.0 * std:  # as good as none: a bound says more
        most = abs(read(spread.noise.theta)) + norm.ppf(0.95) * std
        reason = f"below {quantities.number(most, 2)} {readings[name][0]} (95 %)"
    more = "record slow ramps of the goal as well" if servo else "record the next experiment (qpal design FILE)"
    return ValueEvidence(False, f"{reason}: {more}", row.counts)


def _sum(a: Reading, b: Reading) -> Reading:
    return a[0], lambda theta: a[1](theta) + b[1](theta), a[2] + b[2]

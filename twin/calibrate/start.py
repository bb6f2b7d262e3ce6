"""The start of a calibration: an actuated joint fitted to the logs, its physical values as parameters of the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError
from sysid.base.rates import same_rate
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.joint.values import JointValue, joint_values
from sysid.solver.iterate import Options
from sysid.structures import actuated_joint
from twin.calibrate.leg import DELAY, ROWS
from twin.hardware.actuator import check_rotor, drive, motor
from twin.hardware.linkage import end_angles, linkage
from twin.log import Log
from twin.parameters import Parameters
from twin.truth import arm, linear_bench, link_inertia, load

SURE = 0.1  # of the stroke: an end with a wider interval to each side is not taken over
ROUGH = 0.5  # of the value, the same for speed and friction
NEAR = 0.03  # of the range from its ends
CLEAR = np.deg2rad(1.0)  # of an end that no log strikes from the angles that the logs reach
PUSH = 0.1  # of the friction: a voltage above it by this much would drive the joint on
RESTS = 2.0  # times the time in which the joint would pass


@dataclass(frozen=True)
class Start:
    """Parameters to start from, the values of the fitted joint, those taken over by row, and its RMS error [rad].

    `missed` are the rows of ends that no log strikes.
    """

    parameters: Parameters
    values: tuple[JointValue, ...] = ()
    taken: Mapping[str, float] = field(default_factory=dict)
    rms: float = 0.0
    missed: tuple[str, ...] = ()


def from_joint(
    logs: Sequence[Log],
    joint: str,
    base: Parameters,
    names: Sequence[str],
    seed: int = 0,
    options: Options | None = None,
) -> Start:
    """Start at the values of an actuated joint fitted to the logs (to the longest one if their Ts differ).

    Rows not in `names` keep their values, and so do those that the fitted joint does not determine. Logs of the servo
    mode have no voltage to fit a joint to: the start is then `base`.
    """
    if any(log.mode != "voltage" for log in logs):
        return Start(base)
    data = [log.io(joint if log.joint else None) for log in logs]
    longest = max(data, key=lambda run: len(run.y))
    same = all(same_rate(run.Ts, longest.Ts) for run in data)
    record = IOData.merge(*data) if same and len(data) > 1 else longest
    fit = fit_chain(actuated_joint(knots=9, play=False), record, search="lm", starts=4, seed=seed, options=options)
    values = joint_values(fit)
    by_name = {value.name: value for value in values}
    missed_ends = _not_struck(data, by_name)
    for end in missed_ends:
        by_name.pop(end, None)
    low, high = (float(extreme([extreme(run.y) for run in data])) for extreme in (np.min, np.max))
    base = _out_of_the_way(joint, base, missed_ends, low, high)
    row_values = mapped_rows(joint, base, by_name, names)
    rows = [end_row(joint, end) for end in missed_ends]
    if missed_ends == ["end_low"] and joint != "shoulder" and f"{joint}.stroke" not in names:
        rows = []  # with a known stroke, the struck end tells the retracted length
    return Start(base.replace(row_values), values, row_values, float(np.sqrt(fit.criteria.mse)), tuple(rows))


def end_row(joint: str, end: str) -> str:
    """The row that places "end_low" or "end_high" of the joint, the other end held."""
    pair = ("lower", "upper") if joint == "shoulder" else ("retracted_length", "stroke")
    return f"{joint}.{pair[end == 'end_high']}"


def _out_of_the_way(joint: str, p: Parameters, missed_ends: Sequence[str], low: float, high: float) -> Parameters:
    """Parameters whose `missed_ends` lie beyond the angles `low` to `high` that the logs reached; the other end is
    where it was."""
    ends = dict(zip(("end_low", "end_high"), end_angles(p, joint), strict=True))
    for end, reached_angle, outward in (("end_low", low, -1.0), ("end_high", high, 1.0)):
        if end not in missed_ends or outward * (ends[end] - reached_angle) > CLEAR:
            continue
        angle, row = reached_angle + 2.0 * outward * CLEAR, end_row(joint, end)
        if joint == "shoulder":
            p = p.replace({row: angle})
            continue
        triangle, first = linkage(p, joint), p[f"{joint}.retracted_length"]
        length = float(triangle.length(angle))
        if end == "end_high":
            p = p.replace({row: length - first})
        else:
            p = p.replace({row: length, f"{joint}.stroke": first + p[f"{joint}.stroke"] - length})
    return p


def _not_struck(data: Sequence[IOData], values: Mapping[str, JointValue]) -> list[str]:
    """Ends at which no log rests under a voltage that would drive the joint on.

    The fitted joint may put a stop where a log merely turns round. Without a stop, the joint would pass the last part
    of its range at its speed.
    """
    low, high = (float(extreme([extreme(run.y) for run in data])) for extreme in (np.min, np.max))
    part, speed, missed_ends = NEAR * (high - low), values["speed_per_volt"].value, []
    for end, outward, name in (("end_low", -1.0, "coulomb_down"), ("end_high", 1.0, "coulomb_up")):
        threshold, rests = outward * values[name].value, 0.0
        for run in data:
            push = outward * run.u.ravel() - max(threshold, 0.0)
            distance = run.y.ravel() - low if outward < 0.0 else high - run.y.ravel()
            pushing = (distance < part) & (push > PUSH * max(threshold, 0.0) + 0.1)
            passing = part / (speed * float(push[pushing].mean())) if pushing.any() and speed > 0.0 else np.inf
            ends = np.flatnonzero(np.diff(np.concatenate([[0], pushing.astype(int), [0]])))
            rests = max(rests, run.Ts * float(np.max(ends[1::2] - ends[::2], initial=0)) / passing)
        if rests < RESTS:
            missed_ends.append(end)
    return missed_ends


def mapped_rows(
    joint: str, base: Parameters, values: Mapping[str, JointValue], names: Sequence[str]
) -> dict[str, float]:
    """Values of the rows `names` at which the twin has the joint's physical values, within the rows' bounds."""
    p, result = base, dict[str, float]()
    for rule in (_ends, _speed, _friction, _lag, _delay):
        for name, value in rule(joint, p, values).items():
            row = ROWS[name]
            if name in names and np.isfinite(value):
                change = {name: float(np.clip(value, row.lower, row.upper))}
                if _valid(p.replace(change), joint):
                    result |= change
                    p = p.replace(change)
    return result


def _valid(p: Parameters, joint: str) -> bool:
    try:
        end_angles(p, joint)
        check_rotor(p, joint)
    except InputError:
        return False
    return True


def _sure(value: JointValue | None, half: float) -> bool:
    """Whether the fitted joint determines the value to within `half` to each side."""
    if value is None or value.low is None or value.high is None:
        return False
    return value.high - value.low < 2.0 * half


Values = Mapping[str, JointValue]


def _ends(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """Ends of the drive from those of the link; without the weight of a link half the backlash lies between them."""
    low, high = end_angles(p, joint)
    lower, upper = (
        values[n].value if _sure(values.get(n), SURE * (high - low)) else None for n in ("end_low", "end_high")
    )
    if joint == "shoulder":
        half = p["shoulder.backlash"] / 2
        pairs = (("shoulder.lower", lower, half), ("shoulder.upper", upper, -half))
        return {name: value + shift for name, value, shift in pairs if value is not None}
    triangle = linkage(p, joint)
    result, first = dict[str, float](), p[f"{joint}.retracted_length"]
    if lower is not None:
        first = result[f"{joint}.retracted_length"] = float(triangle.length(lower))
    if upper is not None:
        result[f"{joint}.stroke"] = float(triangle.length(upper)) - first
    return result


def _speed(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """no_load_speed v0 from speed per volt s: s = (F0 / U) / (F0 / v0 + viscous friction), all at the drive."""
    value = values.get("speed_per_volt")
    if value is None or value.value <= 0.0 or not _sure(value, ROUGH * value.value):
        return {}
    r = abs(arm(joint, p))
    stall = p[f"{joint}.stall_torque" if joint == "shoulder" else f"{joint}.stall_force"]
    drag = p[f"{joint}.viscous"] + p[f"{joint}.bearing_viscous"] / r**2
    braking = stall / p[f"{joint}.rated_voltage"] / (value.value * r) - drag
    return {f"{joint}.no_load_speed": stall / braking if braking > 0.0 else np.nan}


def _friction(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """coulomb and asymmetry from the volts at which it moves up and down, less dead zone, weight and bearing."""
    for name in ("coulomb_up", "coulomb_down"):
        if name not in values or not _sure(values[name], ROUGH * abs(values[name].value)):
            return {}
    weight = load(joint, p, *linear_bench(joint, p))
    per_volt, dead_band = motor(p, joint).force_per_volt, drive(p, joint).dead_band
    dry = []
    for name, direction in (("coulomb_up", 1), ("coulomb_down", -1)):
        volts = values[name].value * direction - dead_band
        bearing = p[f"{joint}.bearing_coulomb"] / abs(arm(joint, p))
        dry.append(volts * per_volt - direction * weight - bearing - p[f"{joint}.load_friction"] * abs(weight))
    mean = (dry[0] + dry[1]) / 2
    tilt = (dry[0] - dry[1]) / 2 / mean if mean > 0.0 else 0.0
    return {f"{joint}.coulomb": max(mean, 0.0), f"{joint}.asymmetry": tilt}


def _lag(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """rotor_inertia from the time constant: inertia over damping, both at the drive."""
    value = values.get("time_constant")
    if value is None or value.value <= 0.0:
        return {}
    constants, r = motor(p, joint), abs(arm(joint, p))
    drag = constants.damping + p[f"{joint}.viscous"] + p[f"{joint}.bearing_viscous"] / r**2
    mass = value.value * drag - link_inertia(joint, *linear_bench(joint, p)) / r**2
    return {f"{joint}.rotor_inertia": mass / constants.gear**2}


def _delay(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    return {DELAY: values["delay"].value} if "delay" in values else {}

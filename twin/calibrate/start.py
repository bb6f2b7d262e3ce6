"""The start of a calibration: an actuated joint fitted to the logs, its physical values as parameters of the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.joint.values import JointValue, joint_values
from sysid.structures import actuated_joint
from twin.calibrate.leg import DELAY, ROWS
from twin.hardware.drive import drive
from twin.hardware.linkage import end_angles, linkage
from twin.hardware.motor import check_rotor, motor
from twin.log import Log
from twin.parameters import Parameters
from twin.truth import arm, linear_bench, link_inertia, load

SURE = 0.1  # a value whose interval is wider than this share of it, or of the stroke for an end, is not taken over


@dataclass(frozen=True)
class Start:
    """Parameters to start from, the values of the fitted joint, and those taken over, by row."""

    parameters: Parameters
    values: tuple[JointValue, ...]
    taken: Mapping[str, float] = field(default_factory=dict)
    rms: float = np.inf


def from_joint(logs: Sequence[Log], joint: str, base: Parameters, names: Sequence[str], seed: int = 0) -> Start:
    """Start at the values of an actuated joint fitted to the logs (to the longest one if their Ts differ).

    Rows not in `names` keep their values, and so do those that the fitted joint does not determine.
    """
    data = [log.io(joint if log.joint else None) for log in logs]
    longest = max(data, key=lambda one: len(one.y))
    same = all(one.Ts == longest.Ts for one in data)
    record = IOData.merge(*data) if same and len(data) > 1 else longest
    fit = fit_chain(actuated_joint(play=False), record, search="lm", starts=4, seed=seed)
    values = joint_values(fit)
    mapped = mapped_rows(joint, base, {v.name: v for v in values}, names)
    return Start(base.replace(mapped), values, mapped, float(np.sqrt(fit.criteria.mse)))


def mapped_rows(
    joint: str, base: Parameters, values: Mapping[str, JointValue], names: Sequence[str]
) -> dict[str, float]:
    """Values of the rows `names` at which the twin has the joint's physical values, within the rows' bounds."""
    p, found = base, dict[str, float]()
    for rule in (_ends, _speed, _friction, _lag, _delay):
        for name, value in rule(joint, p, values).items():
            row = ROWS[name]
            if name in names and np.isfinite(value):
                one = {name: float(np.clip(value, row.lower, row.upper))}
                if _valid(p.replace(one), joint):
                    found |= one
                    p = p.replace(one)
    return found


def _valid(p: Parameters, joint: str) -> bool:
    try:
        end_angles(p, joint)
        check_rotor(p, joint)
    except InputError:
        return False
    return True


def _sure(value: JointValue | None, size: float) -> bool:
    """Whether the fitted joint determines the value."""
    if value is None or value.low is None or value.high is None:
        return False
    return value.high - value.low < 2.0 * SURE * abs(size)


Values = Mapping[str, JointValue]


def _ends(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """Ends of the drive from those of the link; without the weight of a link half the backlash lies between them."""
    low, high = end_angles(p, joint)
    size = high - low
    lower, upper = (values[n].value if _sure(values.get(n), size) else None for n in ("end_low", "end_high"))
    if joint == "shoulder":
        half = p["shoulder.backlash"] / 2
        pairs = (("shoulder.lower", lower, half), ("shoulder.upper", upper, -half))
        return {name: value + shift for name, value, shift in pairs if value is not None}
    triangle = linkage(p, joint)
    first = p[f"{joint}.retracted_length"] if lower is None else float(triangle.length(lower))
    found = {} if lower is None else {f"{joint}.retracted_length": first}
    last = p[f"{joint}.retracted_length"] + p[f"{joint}.stroke"] if upper is None else float(triangle.length(upper))
    if lower is not None or upper is not None:
        found[f"{joint}.stroke"] = last - first
    return found


def _speed(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """no_load_speed v0 from speed per volt s: s = (F0 / U) / (F0 / v0 + viscous friction), all at the drive."""
    value = values.get("speed_per_volt")
    if value is None or value.value <= 0.0:
        return {}
    r = abs(arm(joint, p))
    stall = p[f"{joint}.stall_torque" if joint == "shoulder" else f"{joint}.stall_force"]
    drag = p[f"{joint}.viscous"] + p[f"{joint}.bearing_viscous"] / r**2
    braking = stall / p[f"{joint}.rated_voltage"] / (value.value * r) - drag
    return {f"{joint}.no_load_speed": stall / braking if braking > 0.0 else np.nan}


def _friction(joint: str, p: Parameters, values: Values) -> dict[str, float]:
    """coulomb and asymmetry from the volts at which it moves up and down, less dead zone, weight and bearing."""
    if not {"coulomb_up", "coulomb_down"} <= set(values):
        return {}
    held = load(joint, p, *linear_bench(joint, p))
    per_volt, lost = motor(p, joint).force_per_volt, drive(p, joint).dead_band
    dry = []
    for name, direction in (("coulomb_up", 1), ("coulomb_down", -1)):
        volts = values[name].value * direction - lost
        bearing = p[f"{joint}.bearing_coulomb"] / abs(arm(joint, p))
        dry.append(volts * per_volt - direction * held - bearing - p[f"{joint}.load_friction"] * abs(held))
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

"""Parameters and truth of the twin, for `qpal info`."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import twin
from sysid.base.files import versions
from twin.hardware.actuator import drive, dry_friction, motor
from twin.hardware.linkage import end_angles, linkage, stroke
from twin.parameters import JOINTS, TABLE, Parameters, Row
from twin.plant.leg import check_joint
from twin.truth import Truth, arm

POINTS = 101  # of a curve
SPEEDS = 1000  # that are tried, equally spaced on a logarithmic scale


@dataclass(frozen=True)
class Value:
    """A parameter in use: its row of the table and its value in the row's unit."""

    row: Row
    value: float

    @property
    def changed(self) -> bool:
        """Whether the value differs from nominal."""
        return self.value != self.row.nominal

    @property
    def assumed(self) -> bool:
        """Whether the nominal value has no documented source."""
        return self.row.source.startswith("assumption")


@dataclass(frozen=True)
class Geometry:
    """A linear actuator across its joint, from end to end: angle (n,) [rad], length pin to pin (n,) [m] and moment arm
    dL/dq (n,) [m]."""

    angle: np.ndarray
    length: np.ndarray
    arm: np.ndarray


@dataclass(frozen=True)
class Branch:
    """Steady motion in one direction at mid stroke, from the smallest command that maintains it to the full supply.

    voltage (n,) [V] and speed (n,) [rad/s], empty if the supply cannot maintain the motion. breakaway [V]: command that
    starts it from rest, from the truth; jump [rad/s]: the speed after the start, 0 if it does not start. crossing [s]:
    approximate time from end to end at full supply with the speed of mid stroke; infinite if it does not start.
    """

    voltage: np.ndarray
    speed: np.ndarray
    breakaway: float
    jump: float
    crossing: float

    @property
    def starts(self) -> bool:
        """Whether the supply can start it."""
        return self.jump != 0.0

    @property
    def top_speed(self) -> float:
        """Speed [rad/s] at full supply, 0 if it does not start."""
        return float(self.speed[-1]) if self.starts else 0.0


@dataclass(frozen=True)
class Joint:
    """One joint: its truth, its motion down and up, and its actuator's geometry (None for a motor on the joint)."""

    name: str
    truth: Truth
    down: Branch
    up: Branch
    geometry: Geometry | None


@dataclass(frozen=True)
class Information:
    """Values of the parameters, and the requested joints; `source` is the file that changed parameters."""

    values: tuple[Value, ...]
    joints: tuple[Joint, ...]
    Ts: float
    supply: float  # [V]
    source: str | None = None

    @property
    def changed(self) -> tuple[Value, ...]:
        """The values that differ from nominal."""
        return tuple(v for v in self.values if v.changed)

    @property
    def assumed(self) -> int:
        """Number of values that are nominal and assumed."""
        return sum(v.assumed and not v.changed for v in self.values)

    def groups(self) -> dict[str, tuple[Value, ...]]:
        """The values by joint; shared values come first, under an empty name."""
        by_joint: dict[str, list[Value]] = {"": []}
        for v in self.values:
            by_joint.setdefault(v.row.name.rpartition(".")[0], []).append(v)
        return {name: tuple(group) for name, group in by_joint.items() if group}

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal info`, ready for JSON."""
        return {
            "file": self.source,
            "Ts": self.Ts,
            "parameters": [{**asdict(v.row), "value": v.value, "changed": v.changed} for v in self.values],
            "truth": {joint.name: joint.truth.as_dict() for joint in self.joints},
            "static": {j.name: {"down": _static(j.down), "up": _static(j.up)} for j in self.joints},
            "versions": versions(),
        }


def inform(
    joint: str | None = None, Ts: float = 0.1, parameters: Parameters | None = None, source: str | None = None
) -> Information:
    """All about `joint`, or about every joint, at sampling time Ts [s].

    With a joint, the parameters are its own and the shared ones. Raises InputError for an invalid joint or Ts.
    """
    p = parameters or Parameters()
    if joint is not None:
        check_joint(joint)
    names = JOINTS if joint is None else (joint,)
    joints = tuple(_joint(name, Ts, p) for name in names)
    prefixes = tuple(f"{name}." for name in JOINTS if name not in names)
    values = tuple(Value(row, p[row.name]) for row in TABLE if not row.name.startswith(prefixes))
    return Information(values, joints, Ts, p["supply_voltage"], source)


def _joint(name: str, Ts: float, p: Parameters) -> Joint:
    truth = twin.truth(name, Ts, p)
    return Joint(name, truth, branch(truth, -1, p), branch(truth, 1, p), geometry(name, p))


def geometry(joint: str, parameters: Parameters) -> Geometry | None:
    """The actuator of `joint` over its travel; None for a joint with a direct motor."""
    if joint == "shoulder":
        return None
    triangle = linkage(parameters, joint)
    angle = np.linspace(*end_angles(parameters, joint), POINTS)
    return Geometry(angle, triangle.length(angle), np.array([triangle.arm(q) for q in angle]))


def branch(truth: Truth, direction: int, parameters: Parameters) -> Branch:
    """Steady motion of the joint of `truth` up (1) or down (-1) in angle, from its drive and its friction."""
    p, constants = parameters, motor(parameters, truth.joint)
    r, supply = arm(truth.joint, p), p["supply_voltage"]
    v = supply / (constants.constant * constants.gear) * np.geomspace(1e-6, 3.0, SPEEDS)  # beyond 1: a load may help
    volts = direction * steady_command(truth, direction * v, p)
    v, volts = v[np.isfinite(volts)], volts[np.isfinite(volts)]
    # Below the smallest command, friction falls faster with speed than back-EMF rises: no steady motion.
    least = int(np.argmin(volts)) if len(volts) else 0
    breakaway = truth.breakaway_voltage[int(direction > 0)]
    if not np.any(volts <= supply):
        return Branch(np.empty(0), np.empty(0), breakaway, 0.0, np.inf)
    fastest = float(np.interp(supply, volts[least:], v[least:]))
    speed = np.linspace(v[least], fastest, POINTS)
    voltage = np.interp(speed, v, volts)
    jump, crossing = 0.0, np.inf
    if direction * breakaway <= supply:
        jump = float(np.interp(direction * breakaway, np.maximum.accumulate(voltage), speed))
        low, high = stroke(p, truth.joint)
        crossing = (high - low) / fastest
    return Branch(direction * voltage, direction * speed / r, breakaway, direction * jump / r, crossing)


def steady_command(truth: Truth, v: np.ndarray, parameters: Parameters) -> np.ndarray:
    """Command (n,) [V] that keeps the drive at speeds v (n,) [m/s or rad/s], none of them 0; nan if no command can.

    With K the motor's constant, g its gear, R its resistance: the current is i = F / (K g) for the force F of weight,
    friction and bearing at that speed, the motor's voltage R i + K g v = d (V0 - Rs d i) on a supply V0 of resistance
    Rs at duty d. PWM's levels are left out.
    """
    p, joint = parameters, truth.joint
    constants, board, dry = motor(p, joint), drive(p, joint), dry_friction(p, joint)
    r, way = arm(joint, p), np.sign(v)
    load_force = truth.load + way * p[f"{joint}.bearing_coulomb"] / r + p[f"{joint}.bearing_viscous"] * v / r**2
    coulomb = np.where(v > 0, dry.up, dry.down) * (1 + dry.stribeck * np.exp(-((v / dry.stribeck_speed) ** 2)))
    force = load_force + p[f"{joint}.viscous"] * v + way * (coulomb + dry.load * np.abs(load_force))
    emf = constants.constant * constants.gear
    current = force / emf
    volts = constants.resistance * current + emf * v
    square = board.supply**2 - 4 * board.resistance * current * volts
    duty = 2 * volts / (board.supply + np.sqrt(np.where(square < 0, np.nan, square)))
    return duty * board.supply + np.sign(volts) * board.dead_band


def _static(motion: Branch) -> dict[str, Any]:
    return {
        "breakaway_voltage": motion.breakaway,
        "least_voltage": float(motion.voltage[0]) if motion.starts else None,
        "top_speed": motion.top_speed,
        "crossing_seconds": motion.crossing,
    }

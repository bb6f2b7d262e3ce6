"""What the twin is made of and what is true of it: what `qpal info` does."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import twin
from twin.geometry import end_angles, linkage, middle, stroke
from twin.leg import check_joint
from twin.parameters import JOINTS, TABLE, Parameters, Row
from twin.truth import Truth
from twin.versions import versions

POINTS = 101  # of a curve over a joint's travel


@dataclass(frozen=True)
class Value:
    """A parameter as it is used: its row of the table and its value, in the row's unit."""

    row: Row
    value: float

    @property
    def changed(self) -> bool:
        """Whether the value differs from nominal."""
        return self.value != self.row.nominal

    @property
    def assumed(self) -> bool:
        """Whether no document stands behind the nominal value."""
        return self.row.source.startswith("assumption")


@dataclass(frozen=True)
class Geometry:
    """A linear actuator across its joint, from end to end: angle (n,) [rad], length pin to pin (n,) [m] and moment arm
    dL/dq (n,) [m]."""

    angle: np.ndarray
    length: np.ndarray
    arm: np.ndarray


@dataclass(frozen=True)
class Characteristic:
    """Steady speed over voltage at mid stroke, as corners of straight lines: voltage (n,) [V], speed (n,) [rad/s].

    It ends at plus and minus the supply's voltage. Dry friction is taken at the level at which the joint breaks away.
    crossing [s]: about how long the joint takes from end to end at the supply's voltage, towards smaller and larger
    angles; infinite where it does not move. The speed of rod or shaft is taken to be that at mid stroke all the way.
    """

    voltage: np.ndarray
    speed: np.ndarray
    crossing: tuple[float, float]

    @property
    def top_speed(self) -> tuple[float, float]:
        """Speeds [rad/s] at minus and plus the supply's voltage."""
        return float(self.speed[0]), float(self.speed[-1])


@dataclass(frozen=True)
class Joint:
    """One joint: its truth, its speed over voltage, and its actuator's geometry (None where the motor sits on it)."""

    name: str
    truth: Truth
    characteristic: Characteristic
    geometry: Geometry | None


@dataclass(frozen=True)
class Information:
    """Values of the parameters, and the joints that were asked for; `source` is the file that changed parameters."""

    values: tuple[Value, ...]
    joints: tuple[Joint, ...]
    Ts: float
    source: str | None = None

    @property
    def changed(self) -> tuple[Value, ...]:
        """The values that differ from nominal."""
        return tuple(v for v in self.values if v.changed)

    @property
    def assumed(self) -> int:
        """How many of the values are nominal and assumed."""
        return sum(v.assumed and not v.changed for v in self.values)

    def groups(self) -> dict[str, tuple[Value, ...]]:
        """The values by the joint that they belong to; those of no single joint under an empty name, first."""
        found: dict[str, list[Value]] = {"": []}
        for v in self.values:
            found.setdefault(v.row.name.rpartition(".")[0], []).append(v)
        return {name: tuple(group) for name, group in found.items() if group}

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal info`, ready for JSON."""
        return {
            "file": self.source,
            "Ts": self.Ts,
            "parameters": [{**asdict(v.row), "value": v.value, "changed": v.changed} for v in self.values],
            "truth": {joint.name: joint.truth.as_dict() for joint in self.joints},
            "static": {joint.name: _static(joint.characteristic) for joint in self.joints},
            "versions": versions(),
        }


def inform(
    joint: str | None = None, Ts: float = 0.1, parameters: Parameters | None = None, source: str | None = None
) -> Information:
    """All about `joint`, or about every joint, at sampling time Ts [s].

    With a joint, the parameters are its own and those of no single joint. Raises InputError for a joint or Ts that does
    not exist.
    """
    p = parameters or Parameters()
    if joint is not None:
        check_joint(joint)
    names = JOINTS if joint is None else (joint,)
    joints = tuple(_joint(name, Ts, p) for name in names)
    others = tuple(f"{name}." for name in JOINTS if name not in names)
    values = tuple(Value(row, p[row.name]) for row in TABLE if not row.name.startswith(others))
    return Information(values, joints, Ts, source)


def _joint(name: str, Ts: float, p: Parameters) -> Joint:
    truth = twin.truth(name, Ts, p)
    return Joint(name, truth, characteristic(truth, p), geometry(name, p))


def geometry(joint: str, parameters: Parameters) -> Geometry | None:
    """The actuator of `joint` over its travel; None for a joint that its motor turns directly."""
    if joint == "shoulder":
        return None
    triangle = linkage(parameters, joint)
    angle = np.linspace(*end_angles(parameters, joint), POINTS)
    return Geometry(angle, triangle.length(angle), np.array([triangle.arm(q) for q in angle]))


def characteristic(truth: Truth, parameters: Parameters) -> Characteristic:
    """Steady speed over voltage: gain (V - V_breakaway) beyond the break-away voltages, rest between them."""
    down, up = truth.breakaway_voltage
    supply = parameters["supply_voltage"]
    voltage = np.unique(np.clip([-supply, down, up, supply], -supply, supply))
    speed = truth.gain * (np.minimum(voltage - down, 0.0) + np.maximum(voltage - up, 0.0))
    low, high = stroke(parameters, truth.joint)
    q = middle(parameters, truth.joint)
    arm = 1.0 if truth.joint == "shoulder" else linkage(parameters, truth.joint).arm(q)
    back, forth = (abs(v) * arm for v in (speed[0], speed[-1]))
    crossing = tuple((high - low) / v if v > 0 else np.inf for v in (back, forth))
    return Characteristic(voltage, speed, (float(crossing[0]), float(crossing[1])))


def _static(curve: Characteristic) -> dict[str, Any]:
    return {
        "voltage": curve.voltage.tolist(),
        "speed": curve.speed.tolist(),
        "crossing_seconds": list(curve.crossing),
    }

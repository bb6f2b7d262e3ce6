"""What can be calibrated at a joint of an MJCF: one row each, with its prior in physical units and its place there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sysid.base.errors import InputError, unknown
from twin.calibrate.problem import Free
from twin.mjcf.robot import Drive, Robot

SHARE = 0.02  # of a joint's largest force: what friction and damping [per unit/s] usually have as their order
QUICK = 100.0  # [1/s^2] acceleration by inertia that stands for the largest force of a joint that names none
LONGEST = 0.1  # [s] delay of a bus and of the electronics behind it


@dataclass(frozen=True)
class Kind:
    """A kind of parameter. `unit` for a hinge and for a slide, `deviation` of the prior in coordinates of the search.

    `read` gives its value in a model, `put` writes one into it, `scale` is what is plausible before a log is seen, by
    the model alone. `lower` and `upper` are its bounds in rad or m where it is an angle.
    """

    name: str
    unit: tuple[str, str]
    deviation: float
    read: Callable[[mujoco.MjModel, Drive], float]
    put: Callable[[mujoco.MjModel, Drive, float], None]
    scale: Callable[[mujoco.MjModel, Drive], float]
    lower: float = 0.0
    upper: float = np.inf
    servo: bool = False  # for position servos alone
    shared: bool = False  # one value for all actuators


@dataclass(frozen=True)
class Parameter:
    """A parameter of a robot: its kind, the place of its drive (None: all), the model's own value, how it is searched.

    `deviation` is that of its prior around `free.start`, in coordinates of the search.
    """

    kind: Kind
    drive: int | None
    before: float
    free: Free
    deviation: float


def force(model: mujoco.MjModel, drive: Drive) -> float:
    """The largest force or torque at the joint [N or N m], by the model's ranges, or by its inertia."""
    gear, k = abs(float(model.actuator_gear[drive.index, 0])) or 1.0, drive.index
    if model.actuator_forcelimited[k]:
        return float(np.abs(model.actuator_forcerange[k]).max()) * gear
    if not drive.servo and model.actuator_ctrllimited[k] and model.actuator_gainprm[k, 0] > 0.0:
        return float(np.abs(model.actuator_ctrlrange[k]).max() * model.actuator_gainprm[k, 0]) * gear
    return QUICK * inertia(model, drive)


def inertia(model: mujoco.MjModel, drive: Drive) -> float:
    """The inertia that the joint moves in the model's first pose, with the armature [kg or kg m^2]."""
    return 1.0 / float(model.dof_invweight0[drive.dof]) if model.dof_invweight0[drive.dof] > 0.0 else 1e-3


def _reader(name: str) -> Callable[[mujoco.MjModel, Drive], float]:
    """From a field of MjModel with one number a degree of freedom."""
    return lambda model, drive: float(getattr(model, name)[drive.dof])


def _writer(name: str) -> Callable[[mujoco.MjModel, Drive, float], None]:
    """Into the same."""

    def put(model: mujoco.MjModel, drive: Drive, value: float) -> None:
        getattr(model, name)[drive.dof] = value

    return put


def _of_dof(name: str, unit: tuple[str, str], scale: Callable[[mujoco.MjModel, Drive], float]) -> Kind:
    return Kind(name, unit, 2.0, _reader(f"dof_{name}"), _writer(f"dof_{name}"), scale)


def _put_kp(model: mujoco.MjModel, drive: Drive, value: float) -> None:
    model.actuator_gainprm[drive.index, 0], model.actuator_biasprm[drive.index, 1] = value, -value


def _put_kv(model: mujoco.MjModel, drive: Drive, value: float) -> None:
    model.actuator_biasprm[drive.index, 2] = -value


def _put_gain(model: mujoco.MjModel, drive: Drive, value: float) -> None:
    model.actuator_gainprm[drive.index, 0] = value


def _put_bias(model: mujoco.MjModel, drive: Drive, value: float) -> None:
    """The servo controls what its encoder reads, the angle plus the offset."""
    k = drive.index
    model.actuator_biasprm[k, 0] += model.actuator_biasprm[k, 1] * model.actuator_gear[k, 0] * value


def _outside(model: mujoco.MjModel, drive: Drive, value: float) -> None:
    """It acts on the command or on the reading, see `twin.mjcf.simulation`."""


def _friction(model: mujoco.MjModel, drive: Drive) -> float:
    return SHARE * force(model, drive)


# kp is put before bias, which depends on it.
KINDS = {
    kind.name: kind
    for kind in (
        _of_dof("armature", ("kg m^2", "kg"), lambda m, d: 0.2 * inertia(m, d)),
        _of_dof("damping", ("N m s/rad", "N s/m"), _friction),
        _of_dof("frictionloss", ("N m", "N"), _friction),
        Kind(
            "kp",
            ("N m/rad", "N/m"),
            0.7,
            lambda m, d: float(m.actuator_gainprm[d.index, 0]),
            _put_kp,
            lambda m, d: 0.01 * float(m.actuator_gainprm[d.index, 0]),
            servo=True,
        ),
        Kind(
            "kv",
            ("N m s/rad", "N s/m"),
            2.0,
            lambda m, d: -float(m.actuator_biasprm[d.index, 2]),
            _put_kv,
            _friction,
            servo=True,
        ),
        Kind(
            "gain",
            ("N m per unit", "N per unit"),
            0.7,
            lambda m, d: float(m.actuator_gainprm[d.index, 0]),
            _put_gain,
            lambda m, d: 0.01 * abs(float(m.actuator_gainprm[d.index, 0])),
        ),
        Kind(
            "delay",
            ("s", "s"),
            2.0,
            lambda m, d: float(m.actuator_delay[d.index]),
            _outside,
            lambda m, d: 0.005,
            upper=LONGEST,
            shared=True,
        ),
        Kind("bias", ("rad", "m"), 1.0, lambda m, d: 0.0, _put_bias, lambda m, d: 0.05, -np.inf),
        Kind("backlash", ("rad", "m"), 1.0, lambda m, d: 0.0, _outside, lambda m, d: 0.01, upper=0.2),
    )
}
USUAL = ("armature", "damping", "frictionloss", "delay", "bias")


def parameters(robot: Robot, names: Sequence[str] = USUAL) -> tuple[Parameter, ...]:
    """The parameters of all drives, kind by kind; a value that the model leaves 0 starts at what is plausible.

    Raises InputError for an unknown kind and for gains of an actuator that does not have them.
    """
    chosen = set(names)
    for name in names:
        if name not in KINDS:
            raise unknown("parameter", name, KINDS)
    if {"damping", "kv"} <= chosen:  # their sum alone acts, but for a force at its limit
        raise InputError("damping and kv are both free, and only their sum acts on a joint; free one of the two")
    out = []
    for kind in (kind for kind in KINDS.values() if kind.name in chosen):
        for k, drive in enumerate(robot.drives):
            if kind.servo and not drive.servo:
                raise InputError(
                    f"{kind.name} is free, and actuator {drive.name!r} is no position servo; leave it out of --free"
                    + (", or free gain" if kind.name == "kp" else "")
                )
            if kind.name == "gain" and drive.servo:
                raise InputError(f"gain is free, and actuator {drive.name!r} is a position servo; free kp instead")
            if not (kind.shared and k):
                out.append(_parameter(robot.model, kind, drive, None if kind.shared else k))
    return tuple(out)


def _parameter(model: mujoco.MjModel, kind: Kind, drive: Drive, place: int | None) -> Parameter:
    before, scale = kind.read(model, drive), kind.scale(model, drive)
    start = scale if before == 0.0 and kind.lower == 0.0 else min(max(before, kind.lower), kind.upper)
    name = kind.name if place is None else f"{drive.name}.{kind.name}"
    unit = kind.unit[0 if drive.unit == "rad" else 1]
    free = Free(name, start, kind.lower, kind.upper, unit, scale)
    return Parameter(kind, place, before, free, kind.deviation)

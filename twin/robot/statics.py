"""Statics of the standing robot: loads and speeds of the actuators, and stability."""

from collections.abc import Callable

import mujoco
import numpy as np

from twin.hardware.actuator import dry_friction, motor
from twin.hardware.linkage import linkage
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import LEGS

GRAVITY_ROWS = [2, 3, 4]  # of the floating base: force up, moments about x and y


class Statics:
    """Statics of `model`, a compiled robot with `parameters`; actuators in the model's order, 12 of them."""

    def __init__(self, model: mujoco.MjModel, parameters: Parameters) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self.names = [model.actuator(k).name for k in range(model.nu)]
        hinges = [model.joint(name) for name in self.names]
        self._qpos = np.array([hinge.qposadr[0] for hinge in hinges])
        self._dofs = np.array([hinge.dofadr[0] for hinge in hinges])
        self._feet = [model.site(f"foot{suffix}").id for suffix in LEGS.values()]
        self._linkages = {joint: linkage(parameters, joint) for joint in JOINTS if joint != "shoulder"}
        motors = {joint: motor(parameters, joint) for joint in JOINTS}
        frictions = {joint: dry_friction(parameters, joint) for joint in JOINTS}
        self._per_volt = _per_actuator(lambda joint: motors[joint].force_per_volt)
        self._dead_band = parameters["dead_band"]
        self.stall = self._per_volt * parameters["supply_voltage"]
        self._damping = _per_actuator(lambda joint: motors[joint].damping + parameters[f"{joint}.viscous"])
        self._up, self._down, self._stribeck, self._fade, self._per_load = (
            np.tile([getattr(frictions[joint], name) for joint in JOINTS], len(LEGS))
            for name in ("up", "down", "stribeck", "stribeck_speed", "load")
        )

    def pose(self, torso: np.ndarray, angles: np.ndarray) -> mujoco.MjData:
        """The model at rest with a level torso at (3,) [m] and joint angles (12,) [rad], the backlash centred."""
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[:3] = torso
        data.qpos[self._qpos] = angles
        mujoco.mj_fwdPosition(self._model, data)
        return data

    def travel(self, angles: np.ndarray) -> np.ndarray:
        """Position (12,) of each actuator, rod length [m] or shoulder angle [rad], at joint angles (12,) [rad]."""
        rows = np.asarray(angles).reshape(len(LEGS), len(JOINTS))
        columns = [rows[:, 0]] + [self._linkages[joint].length(rows[:, k]) for k, joint in enumerate(JOINTS) if k]
        return np.stack(columns, axis=-1).ravel()

    def loads(self, torso: np.ndarray, angles: np.ndarray, stance: np.ndarray) -> np.ndarray:
        """Force (12,) [N], or torque [N m] of a shoulder, that holds the pose with vertical forces at the feet that
        stand (4,). With four feet the least-squares forces are used, as for equal springs under the feet."""
        data = self.pose(torso, angles)
        gravity = np.zeros(self._model.nv)
        mujoco.mj_rne(self._model, data, 0, gravity)
        jacobian = np.zeros((3, self._model.nv))
        rows = []
        for site, stands in zip(self._feet, stance, strict=True):
            mujoco.mj_jacSite(self._model, data, jacobian, None, site)
            rows.append(jacobian[2] * float(stands))
        lift = np.array(rows)  # (4, nv): generalised forces of one newton under each foot
        forces = np.linalg.lstsq(lift[:, GRAVITY_ROWS].T, gravity[GRAVITY_ROWS], rcond=None)[0]
        return (gravity - lift.T @ forces)[self._dofs] / self._arms(angles)

    def needs(self, loads: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Actuator force (..., 12) in the direction of `speed` (..., 12) [m/s or rad/s] that moves `loads`
        (..., 12): the load and dry friction; just above speed 0 the break-away force."""
        dry = np.where(speed > 0, self._up, self._down) * (1 + self._stribeck * np.exp(-((speed / self._fade) ** 2)))
        return np.where(speed == 0, 0.0, dry + self._per_load * np.abs(loads) + loads * np.sign(speed))

    def volts(self, loads: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Command (..., 12) [V] that moves `loads` at `speed`; 0 for speed 0, where friction holds."""
        force = np.sign(speed) * self.needs(loads, speed) + self._damping * speed
        return force / self._per_volt + np.sign(speed) * self._dead_band

    def speeds(self, needs: np.ndarray, effort: float) -> np.ndarray:
        """Speed (..., 12) [m/s or rad/s] available at `effort` times the supply under the forces `needs` (..., 12)."""
        return (effort * self.stall - np.maximum(needs, 0.0)) / self._damping

    def margin(self, torso: np.ndarray, angles: np.ndarray, feet: np.ndarray, stance: np.ndarray) -> float:
        """Distance [m] of the centre of mass inside the support polygon of the feet (4, 3) that stand (4,)."""
        data = self.pose(torso, angles)
        return stability_margin(data.subtree_com[1, :2], feet[stance, :2])

    def _arms(self, angles: np.ndarray) -> np.ndarray:
        rows = np.asarray(angles).reshape(len(LEGS), len(JOINTS))
        arms = np.ones_like(rows)
        for k, joint in enumerate(JOINTS):
            if k:
                arms[:, k] = [self._linkages[joint].arm(angle) for angle in rows[:, k]]
        return arms.ravel()


def _per_actuator(value: Callable[[str], float]) -> np.ndarray:
    """The value of each joint (12,), leg by leg."""
    return np.tile([float(value(joint)) for joint in JOINTS], len(LEGS))


def stability_margin(centre: np.ndarray, feet: np.ndarray) -> float:
    """Static stability margin [m]: distance of `centre` (2,) from the nearest edge of the polygon of `feet` (n, 2),
    counter-clockwise as seen from above, positive inside (McGhee and Frank 1968). -inf for fewer than three feet."""
    if len(feet) < 3:
        return -np.inf
    edges = np.roll(feet, -1, axis=0) - feet
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=-1) / np.linalg.norm(edges, axis=1, keepdims=True)
    return float(np.min(np.sum((centre - feet) * inward, axis=1)))

"""The whole robot with its twelve joints in servo mode: from planned angles to references, and to its motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch

from twin.hardware.potentiometer import potentiometer
from twin.parameters import JOINTS, Parameters
from twin.plant import slots
from twin.plant.board import user_data
from twin.plant.leg import LEGS, robot, robot_circuits
from twin.plant.stepping import TIMESTEP, boards
from twin.robot.gait import Plan
from twin.robot.statics import Statics

SETTLE = 1.0  # [s] that the first reference is held before the record starts


@dataclass(frozen=True)
class Walk:
    """The motion of a robot, sampled every `Ts` [s] at the end of the interval in which the row's reference is held.

    `references`, `angles` (N, 12) [rad] in the order of the model's actuators; `volts` (N, 12) [V] at the motors;
    `speeds` (N, 12) [m/s, shoulder rad/s] of the drives; `qpos` (N, nq); `parameters` are the robot's.
    """

    parameters: Parameters
    Ts: float
    references: np.ndarray
    qpos: np.ndarray
    angles: np.ndarray
    volts: np.ndarray
    speeds: np.ndarray

    @property
    def t(self) -> np.ndarray:
        """Time (N,) [s] of the samples."""
        return self.Ts * np.arange(1, len(self.qpos) + 1)

    @property
    def torso(self) -> np.ndarray:
        """Centre of the torso (N, 3) [m]."""
        return self.qpos[:, :3]

    @property
    def tilt(self) -> np.ndarray:
        """Angle (N,) [rad] of the torso's deck from level."""
        x, y = self.qpos[:, 4], self.qpos[:, 5]
        return np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0))

    @property
    def heading(self) -> np.ndarray:
        """Turn (N,) [rad] of the torso about the vertical."""
        w, x, y, z = self.qpos[:, 3:7].T
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def electrical_power(self) -> np.ndarray:
        """Power (N, 12) [W] of each motor, V i with i = (V - K w) / R; no power returns to the supply."""
        circuits = robot_circuits(self.parameters)
        constant, gear, resistance = (
            np.array([getattr(joint_circuit.motor, name) for joint_circuit in circuits])
            for name in ("constant", "gear", "resistance")
        )
        return np.maximum(self.volts * (self.volts - constant * gear * self.speeds) / resistance, 0.0)

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Feet (N, 4, 3) [m], their orientation (N, 4, 3, 3) and the robot's centre of mass (N, 3) [m]."""
        model = robot(self.parameters)
        data = mujoco.MjData(model)
        sites = [model.site(f"foot{suffix}").id for suffix in LEGS.values()]
        feet, turns, centre = [], [], []
        for row in self.qpos:
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            feet.append(data.site_xpos[sites])
            turns.append(data.site_xmat[sites].reshape(-1, 3, 3))
            centre.append(data.subtree_com[1].copy())
        return np.array(feet), np.array(turns), np.array(centre)


def drive(
    robots: Sequence[Parameters],
    references: np.ndarray,
    Ts: float,
    torso: np.ndarray,
    seeds: Sequence[int],
    power: bool = True,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Walk]:
    """The motions of robots with these parameters for one set of references (N, 12) [rad], each held for `Ts` [s].

    They start at rest with the first reference and a level torso at (3,) [m]; `seeds`, one per robot, draw the noise
    of the servos' potentiometers. Without `power` no motor gets a voltage. `progress` receives the completed share, 0
    to 1.
    """
    models = [robot(parameters) for parameters in robots]
    first = models[0]
    batch = Batch(first, len(robots), threads)
    batch.set_models(models)
    circuits = [robot_circuits(parameters) for parameters in robots]
    batch.qpos = np.stack([_pose(model, torso, references[0]) for model in models])
    every = zip(models, circuits, seeds, strict=True)
    batch.userdata = np.stack([user_data(model, row, servo=power, seed=seed) for model, row, seed in every])
    scales = np.array([[joint_circuit.pot.scale for joint_circuit in row] for row in circuits])
    steps_per_sample, delays = round(Ts / TIMESTEP), [round(parameters["delay"] / TIMESTEP) for parameters in robots]
    rows: dict[str, list[np.ndarray]] = {"qpos": [], "sensordata": [], "actuator_velocity": []}
    settle = round(SETTLE / Ts)
    with boards():
        for k in range(-settle, len(references)):
            # The servo's command has the transport delay too: the previous reference still arrives first.
            indices = [np.where(np.arange(steps_per_sample) < n, max(k - 1, 0), max(k, 0)) for n in delays]
            commands = np.stack([references[index] * scale for index, scale in zip(indices, scales, strict=True)])
            sample = batch.rollout(steps_per_sample, commands if power else np.zeros_like(commands), record=tuple(rows))
            if k >= 0:
                for name, values in rows.items():
                    values.append(sample[name][:, -1])
            progress((k + settle + 1) / (settle + len(references)))
    arrays = {name: np.stack(values, axis=1) for name, values in rows.items()}
    gears = first.actuator_gear[:, 0]
    return [
        _walk(parameters, Ts, references, {name: values[i] for name, values in arrays.items()}, gears)
        for i, parameters in enumerate(robots)
    ]


def _walk(
    parameters: Parameters, Ts: float, references: np.ndarray, rows: dict[str, np.ndarray], gears: np.ndarray
) -> Walk:
    outputs = rows["sensordata"].reshape(len(references), -1, slots.COLUMNS)
    speeds = rows["actuator_velocity"] / gears
    angles, volts = outputs[:, :, slots.ANGLE], outputs[:, :, slots.VOLTS]
    return Walk(parameters, Ts, references, rows["qpos"], angles, volts, speeds)


def _pose(model: mujoco.MjModel, torso: np.ndarray, angles: np.ndarray) -> np.ndarray:
    qpos = np.array(model.qpos0)
    qpos[:3] = torso
    for k, angle in enumerate(angles):
        qpos[model.joint(model.actuator(k).name).qposadr[0]] = angle
    return qpos


STILL = 1e-5  # [m/s or rad/s] below this an actuator is at rest
KEPT = 0.2  # [s] for which the feed-forward continues after the plan is at rest, until the joint arrives


def feedforward_references(plan: Plan, parameters: Parameters | None = None) -> np.ndarray:
    """References (N, 12) [rad] for robots with `parameters` to follow the plan's angles."""
    parameters = parameters or Parameters()
    model = robot(parameters)
    statics = Statics(model, parameters)
    speed = np.gradient(np.array([statics.travel(row) for row in plan.angles]), plan.Ts, axis=0)
    speed[np.abs(speed) < STILL] = 0.0
    loads = np.array([statics.loads(*row) for row in zip(plan.torso, plan.angles, plan.stance, strict=True)])
    limit = parameters["supply_voltage"]
    volts = np.clip(statics.volts(loads, speed), -limit, limit)
    scale = potentiometer(parameters).scale
    gains = np.tile([parameters[f"{joint}.servo_kp"] * scale for joint in JOINTS], len(LEGS))  # [V/rad]
    lead = np.divide(volts, gains, out=np.zeros_like(volts), where=gains > 0)
    return plan.angles + _hold_last(lead, round(KEPT / plan.Ts))


def _hold_last(lead: np.ndarray, samples: int) -> np.ndarray:
    """The feed-forward with each last value before zeros held for up to `samples` of them."""
    out = lead.copy()
    for _ in range(samples):
        previous = np.roll(out, 1, axis=0)
        previous[0] = 0.0
        # one sample further each time, never over the start of the next feed-forward
        out = np.where(out == 0.0, previous, out)
    return out

"""The twin's leg in a pose as a few cylinders between points, by MuJoCo's forward kinematics."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from twin.parameters import JOINTS, Parameters
from twin.plant.leg import BENCH_LEG, robot
from twin.view.stills import on_stand

TORSO, LINK, FOOT, MOTOR, ROD, STAND = "#475569", "#2f6f8f", "#1f2933", "#c2410c", "#9aa5b1", "#64748b"


@dataclass(frozen=True)
class Bar:
    """A cylinder of `radius` [m] from `start` to `stop` (3,) [m]; equal points are a ball."""

    name: str
    radius: float
    start: np.ndarray
    stop: np.ndarray
    colour: str

    @property
    def length(self) -> float:
        """Distance of its ends [m]."""
        return float(np.linalg.norm(self.stop - self.start))

    def turn(self) -> np.ndarray:
        """Rotation (3, 3) that takes the y axis, along which a cylinder of the scene lies, to this bar."""
        if self.length < 1e-9:
            return np.eye(3)
        along = (self.stop - self.start) / self.length
        other = np.array([1.0, 0.0, 0.0]) if abs(along[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
        side = np.cross(other, along)
        side /= np.linalg.norm(side)
        return np.column_stack([side, along, np.cross(side, along)])


class Leg:
    """The front left leg on a stand; joints without a record are at mid stroke."""

    def __init__(self, parameters: Parameters | None = None) -> None:
        self._parameters = parameters or Parameters()
        self._model = robot(self._parameters)
        self._data = mujoco.MjData(self._model)

    def bars(self, angles: Mapping[str, float]) -> list[Bar]:
        """The bars at these joint angles [rad], always of the same names in the same order."""
        data = self._data
        data.qpos[:] = on_stand(self._model, self._parameters, angles)
        mujoco.mj_kinematics(self._model, data)
        torso = np.array(data.body("torso").xpos)
        hub, thigh, shank = (np.array(data.body(f"{part}{BENCH_LEG}").xpos) for part in PARTS)
        foot = np.array(data.site(f"foot{BENCH_LEG}").xpos)
        floor = np.array([torso[0], torso[1], 0.0])
        found = [
            Bar("stand", 0.02, floor, torso, STAND),
            Bar("torso", 0.05, torso, hub, TORSO),
            Bar("shoulder", 0.03, hub, thigh, LINK),
            Bar("thigh", 0.024, thigh, shank, LINK),
            Bar("shank", 0.02, shank, foot, LINK),
            Bar("foot", 0.03, foot, foot, FOOT),
        ]
        for joint in JOINTS[1:]:
            base, rod = (np.array(data.site(f"{joint}_{end}{BENCH_LEG}").xpos) for end in ("base", "rod"))
            shell = 0.8 * self._model.tendon_range[self._model.tendon(joint + BENCH_LEG).id, 0]
            tip = base + (rod - base) / np.linalg.norm(rod - base) * shell
            found += [Bar(f"{joint} cylinder", 0.014, base, tip, MOTOR), Bar(f"{joint} rod", 0.007, tip, rod, ROD)]
        return found


PARTS = ("shoulder_hub", "thigh_lever", "shank_lever")


def angle_at(t: float, y: np.ndarray, Ts: float) -> float:
    """The measured angle [rad] at time t [s] of a record y (N,), linear between samples."""
    place = min(max(t / Ts, 0.0), len(y) - 1.0)
    k = min(int(place), len(y) - 2)
    return float(y[k] + (place - k) * (y[k + 1] - y[k]))

"""Forward and inverse kinematics in closed form: the leg turns about z, then twice about y."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sysid.base.errors import InputError
from twin.hardware.linkage import end_angles
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import LEGS


@dataclass(frozen=True)
class Leg:
    """Lengths of one leg [m]: `hip` from the shoulder's axis out to the thigh's, then `thigh` and `shank`.

    Frame: origin on the shoulder's axis at the height of the thigh's, x outward at shoulder angle 0, z up. Angles are
    those between the links (backlash included), shoulder, thigh, shank [rad]; `lower` and `upper` (3,) [rad] bound
    them.
    """

    hip: float
    thigh: float
    shank: float
    lower: np.ndarray
    upper: np.ndarray

    def foot(self, angles: np.ndarray) -> np.ndarray:
        """Foot (..., 3) [m] at joint angles (..., 3) [rad]."""
        yaw, thigh, shank = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
        out = self.hip + self.thigh * np.cos(thigh) - self.shank * np.sin(thigh + shank)
        height = -self.thigh * np.sin(thigh) - self.shank * np.cos(thigh + shank)
        return np.stack([out * np.cos(yaw), out * np.sin(yaw), height], axis=-1)

    def angles(self, foot: np.ndarray) -> np.ndarray:
        """Joint angles (..., 3) [rad] that put the foot at (..., 3) [m], with the knee outside and the leg not crossed.

        Raises InputError if a joint would leave its travel, with the joint and the angle.
        """
        foot = np.asarray(foot, dtype=float)
        x, y, z = np.moveaxis(foot, -1, 0)
        side = np.where(x < 0, -1.0, 1.0)  # a foot beyond the shoulder's axis: |yaw| stays below 90 degrees
        out, drop = side * np.hypot(x, y) - self.hip, -z
        # Law of cosines in the triangle thigh, shank, distance; at shank angle 0 the knee encloses a right angle.
        sine = (self.thigh**2 + self.shank**2 - out**2 - drop**2) / (2 * self.thigh * self.shank)
        if np.any(np.abs(sine) > 1):
            k = int(np.argmax(np.abs(sine).ravel()))
            raise InputError(
                f"a foot {_point(foot, k)} from its shoulder is out of the leg's reach; keep it between "
                f"{abs(self.thigh - self.shank):.3f} and {self.thigh + self.shank:.3f} m from the thigh's axis"
            )
        shank = np.arcsin(sine)
        thigh = np.arctan2(drop, out) - np.arctan2(self.shank * np.cos(shank), self.thigh - self.shank * sine)
        result = np.stack([np.arctan2(side * y, side * x), thigh, shank], axis=-1)
        self._check(foot, result)
        return result

    def _check(self, foot: np.ndarray, angles: np.ndarray) -> None:
        excess = np.maximum(self.lower - angles, angles - self.upper)
        if np.all(excess <= 1e-12):
            return
        k, j = np.unravel_index(int(np.argmax(excess)), (excess.size // 3, 3))
        low, high, angle = (np.degrees(v) for v in (self.lower[j], self.upper[j], angles.reshape(-1, 3)[k, j]))
        raise InputError(
            f"a foot {_point(foot, int(k))} from its shoulder needs the {JOINTS[j]} at {angle:.1f} deg; its travel is "
            f"{low:.1f} to {high:.1f} deg, so move the foot or change the height of the body"
        )


@dataclass(frozen=True)
class Body:
    """The torso with its four equal legs, in the order of `LEGS`: shoulders at `mounts` (4, 3) [m] in its frame, their
    outward directions turned by `headings` (4,) [rad] about z; `foot_radius` [m]."""

    leg: Leg
    mounts: np.ndarray
    headings: np.ndarray
    foot_radius: float

    def feet(self, torso: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Feet (..., 4, 3) [m] in the world for a level torso at (..., 3) [m] and joint angles (..., 12) [rad]."""
        angles = np.asarray(angles, dtype=float)
        local = self.leg.foot(angles.reshape(*angles.shape[:-1], 4, 3))
        return _turn(local, self.headings) + self.mounts + np.asarray(torso)[..., None, :]

    def angles(self, torso: np.ndarray, feet: np.ndarray) -> np.ndarray:
        """Joint angles (..., 12) [rad] for a level torso at (..., 3) [m] and feet (..., 4, 3) [m] in the world.

        Raises InputError if a foot is out of reach.
        """
        local = _turn(np.asarray(feet) - self.mounts - np.asarray(torso)[..., None, :], -self.headings)
        return self.leg.angles(local).reshape(*local.shape[:-2], 12)


def body(parameters: Parameters, model: mujoco.MjModel) -> Body:
    """The lengths of `model`, a compiled robot, with the travel that `parameters` allow."""
    suffixes = tuple(LEGS.values())
    first = suffixes[0]
    ends = np.array([end_angles(parameters, joint) for joint in JOINTS])
    leg = Leg(
        hip=float(model.body(f"thigh_lever{first}").pos[0]),
        thigh=float(model.body(f"shank_lever{first}").pos[0]),
        shank=float(-model.site(f"foot{first}").pos[2]),
        lower=ends[:, 0],
        upper=ends[:, 1],
    )
    hubs = [model.body(f"shoulder_hub{suffix}") for suffix in suffixes]
    headings = np.array([2 * np.arctan2(hub.quat[3], hub.quat[0]) for hub in hubs])
    return Body(leg, np.array([hub.pos for hub in hubs]), headings, float(model.geom(f"foot{first}").size[0]))


def _turn(points: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Points (..., 4, 3) turned about z by `angles` (4,) [rad]."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def _point(foot: np.ndarray, k: int) -> str:
    x, y, z = foot.reshape(-1, 3)[k]
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"

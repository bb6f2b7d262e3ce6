"""A recorded movement of the leg as poses of the robot on a stand, with a second record as a ghost leg.

Kinematic: joint angles are set without simulation. The ghost is the rear left leg of the same model, moved onto the
front left one and made translucent, so both legs are the same leg with the same actuators.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from sysid.base.errors import InputError
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import BENCH_LEG, LEGS, check_joint, robot
from twin.view.stills import on_stand, tint

GHOST_LEG = LEGS["rear_left"]
GHOST = (0.10, 0.50, 1.0, 0.38)
GHOST_SCALE = 0.94  # thinner than the leg, so that it is hidden inside without flicker where the two coincide
HIDDEN = (0.0, 0.0, 0.0, 0.0)
REST = 1.0  # [s] of wall time that the last pose stays before the replay starts again


@dataclass(frozen=True)
class Movement:
    """Joint angles (N,) [rad] by joint at the times t (N,) [s], which increase: the recorded motion of a leg."""

    t: np.ndarray
    angles: Mapping[str, np.ndarray]

    def __post_init__(self) -> None:
        if not self.angles:
            raise InputError("the movement has no joint; give the angles of at least one")
        for joint, angle in self.angles.items():
            check_joint(joint)
            if np.shape(angle) != np.shape(self.t) or np.ndim(angle) != 1 or not len(angle):
                raise InputError(
                    f"{joint} has angles of shape {np.shape(angle)} at times of shape {np.shape(self.t)}; give one "
                    "angle for each time"
                )
            if not np.isfinite(angle).any():
                raise InputError(f"{joint} has no finite angle; give a record with finite angles")

    def angles_at(self, time: float) -> dict[str, float]:
        """Angles [rad] by joint at `time` [s]: linear between measured samples, constant beyond the ends."""
        is_finite = {joint: np.isfinite(angle) for joint, angle in self.angles.items()}
        return {
            joint: float(np.interp(time, self.t[is_finite[joint]], angle[is_finite[joint]]))
            for joint, angle in self.angles.items()
        }


def movement(log: Log, joint: str | None = None) -> Movement:
    """The measured movement of `joint` in `log`; the joint of the log if it names one.

    A log with all three joints has y (N, 3) in the order of `JOINTS`. Raises InputError if the joint is not given, or
    if log and `joint` differ.
    """
    if joint is not None:
        check_joint(joint)
    y = np.asarray(log.y, dtype=float)
    if y.ndim == 2 and y.shape[1] == len(JOINTS):
        columns = {name: y[:, k] for k, name in enumerate(JOINTS)}
        return Movement(log.t, columns if joint is None else {joint: columns[joint]})
    if not (joint or log.joint):
        raise InputError(f"the log does not name the joint that moved; give --joint ({', '.join(JOINTS)})")
    if joint and log.joint and joint != log.joint:
        raise InputError(f"the log names the joint {log.joint} and --joint is {joint}; leave --joint out")
    return Movement(log.t, {joint or log.joint: y.ravel()})


def moment(wall: float, length: float, speed: float = 1.0, rest: float = REST) -> float:
    """Time [s] within a record of `length` [s] that is shown `wall` [s] after the start, at `speed` times real time.

    After the end the last pose stays for `rest` [s] of wall time, then the record starts again.
    """
    return min(speed * (max(wall, 0.0) % (length / speed + rest)), length)


@dataclass(frozen=True)
class Replay:
    """The movement of the leg and optionally of a ghost, from `start` to `stop` [s]; by default all of it."""

    leg: Movement
    ghost: Movement | None = None
    parameters: Parameters | None = None
    start: float = 0.0
    stop: float | None = None

    def __post_init__(self) -> None:
        last = self._last
        stop = last if self.stop is None else self.stop
        if not 0 <= self.start < stop <= last:
            raise InputError(
                f"the replay would go from {self.start:g} to {stop:g} s; the record goes from 0 to {last:g} s: give a "
                "start before the stop, both inside the record"
            )

    @property
    def _last(self) -> float:
        return float(max(part.t[-1] for part in (self.leg, self.ghost) if part is not None))

    @property
    def length(self) -> float:
        """Time [s] that is shown."""
        return (self._last if self.stop is None else self.stop) - self.start

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The robot with one visible leg, two with a ghost; it has no forces, even if it is stepped."""
        model = robot(self.parameters)
        colours = {suffix: HIDDEN for suffix in LEGS.values() if suffix != BENCH_LEG}
        if self.ghost is not None:
            colours[GHOST_LEG] = GHOST
            leg, ghost = model.body(f"shoulder_hub{BENCH_LEG}"), model.body(f"shoulder_hub{GHOST_LEG}")
            ghost.pos, ghost.quat = leg.pos, leg.quat
            ghost_parts = [model.geom(k).name.endswith(GHOST_LEG) for k in range(model.ngeom)]
            model.geom_size[ghost_parts] *= GHOST_SCALE
            ghost_parts = [model.tendon(k).name.endswith(GHOST_LEG) for k in range(model.ntendon)]
            model.tendon_width[ghost_parts] *= GHOST_SCALE
        tint(model, colours)
        flags = mujoco.mjtDisableBit
        model.opt.disableflags |= flags.mjDSBL_GRAVITY | flags.mjDSBL_CONSTRAINT | flags.mjDSBL_ACTUATION
        return model

    def pose(self, time: float) -> np.ndarray:
        """Pose (nq,) of `model` at `time` [s] after the start; joints without a record are at mid stroke."""
        parameters = self.parameters or Parameters()
        qpos = on_stand(self.model, parameters, self.leg.angles_at(self.start + time))
        if self.ghost is not None:
            for joint, angle in self.ghost.angles_at(self.start + time).items():
                qpos[self.model.joint(joint + GHOST_LEG).qposadr[0]] = angle
        return qpos

    def camera(self) -> dict:
        """Entries of `twin.view.stills.CAMERA` that show the whole leg in all its poses."""
        if "shoulder" in self.leg.angles and len(self.leg.angles) == 1:
            return {"lookat": (0.13, 0.24, 0.33), "distance": 1.05, "azimuth": 200.0, "elevation": -48.0}
        return {"lookat": (0.16, 0.26, 0.31), "distance": 1.05, "azimuth": 196.0, "elevation": -12.0}

"""A robot's drives simulated from the commands of a log: many sets of parameters in one batch."""

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from sysid.base.parallel import available_cores
from twin.mjcf.parameters import Parameter
from twin.mjcf.robot import Robot

BLOCK = 2**24  # bytes of commands and positions at a time
NOWHERE: Mapping[str, float] = MappingProxyType({})  # no joint is held elsewhere than in the model
WARNINGS = 1  # a batch's `warning` holds which element was last concerned, then how often


@dataclass(frozen=True)
class Rig:
    """A robot whose `parameters` change from run to run."""

    robot: Robot
    parameters: tuple[Parameter, ...]
    threads: int | None = None

    def model(self, values: np.ndarray) -> mujoco.MjModel:
        """The robot's model with `values` (P,), and the constants that MuJoCo derives from them."""
        model = copy.copy(self.robot.model)
        model.actuator_delay[:], drives = 0.0, self.robot.drives  # delays are in the commands
        for parameter, value in zip(self.parameters, values, strict=True):
            if parameter.drive is not None:
                parameter.kind.put(model, drives[parameter.drive], float(value))
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def of_kind(self, name: str, values: np.ndarray) -> np.ndarray:
        """Values (runs, drives) of a kind: the model's own where it is not among the parameters."""
        drives = self.robot.drives
        out = np.zeros((len(values), len(drives)))
        if name == "delay":
            out += self.robot.model.actuator_delay[[drive.index for drive in drives]]
        for j, parameter in enumerate(self.parameters):
            if parameter.kind.name == name:
                places = slice(None) if parameter.drive is None else [parameter.drive]
                out[:, places] = values[:, [j]]
        return out

    def run(
        self, values: np.ndarray, u: np.ndarray, Ts: float, start: np.ndarray, posture: Mapping[str, float] = NOWHERE
    ) -> np.ndarray:
        """Readings (runs, N, drives) for parameters (runs, P) and commands u (N, drives), in rad or m.

        A command is held from t = k Ts to the next, and reaches the actuator a delay later. `start` (runs, 3, drives)
        has the first reading of each encoder, the speed then, and the command that was held before. Joints of the
        `posture` are held there, other held ones where the model's first pose has them. A row of NaN is a failed run.
        """
        model, drives, runs = self.robot.model, self.robot.drives, len(values)
        h, (N, _) = model.opt.timestep, u.shape
        bias, places = self.of_kind("bias", values), [drive.qpos for drive in drives]
        batch = Batch(model, runs, self.threads or available_cores())
        batch.set_models([self.model(row) for row in values])
        qpos = np.tile(model.qpos0, (runs, 1))
        qpos[:, places] = start[:, 0] - bias
        for name, (place, _) in self.robot.postures.items():
            qpos[:, place] = posture.get(name, model.qpos0[place])
        batch.qpos = qpos
        batch.qvel[:, [drive.dof for drive in drives]] = start[:, 1]
        for k, drive in enumerate(drives):
            if drive.act >= 0:
                batch.act[:, drive.act] = start[:, 2, k]
        instants = np.arange(N) * Ts / h
        previous = np.floor(instants + 1e-6).astype(int)  # rounding must not take a sample for one a step earlier
        share = np.clip(instants - previous, 0.0, 1.0)
        steps = int(previous[-1]) + 1
        track = np.empty((runs, steps + 1, len(drives)))
        track[:, 0] = qpos[:, places]
        delays = self.of_kind("delay", values)
        block = max(BLOCK // (8 * runs * (model.nu + model.nq)), 1)
        alive = np.ones(runs, dtype=bool)
        for begin in range(0, steps, block):
            stop = min(begin + block, steps)
            control = self._control(u, Ts, delays, np.arange(begin, stop + 1) * h, start[:, 2] - u[0])
            out = {"qpos": np.empty((runs, stop - begin, model.nq))}
            try:
                with _counted_alone():
                    batch.rollout(stop - begin, control, out=out)
            except SimulationError as error:  # the others ran to the end
                alive[error.ids] = False
            track[:, begin + 1 : stop + 1] = out["qpos"][:, :, places]
        alive &= ~batch.warning[:, :, WARNINGS].any(axis=1)
        track[~alive] = np.nan
        y = track[:, previous] * (1.0 - share)[:, None] + track[:, previous + 1] * share[:, None] + bias[:, None]
        return _play(y, self.of_kind("backlash", values))

    def _control(
        self, u: np.ndarray, Ts: float, delays: np.ndarray, edges: np.ndarray, earlier: np.ndarray
    ) -> np.ndarray:
        """Commands (runs, steps, nu) between times `edges` (steps + 1,) [s]: the mean of the held one, a delay earlier.

        The mean makes the response a continuous function of the delay. `earlier` (runs, drives) is what the commands
        were more before the first.
        """
        out = np.zeros((len(delays), len(edges) - 1, self.robot.model.nu))
        knots = np.concatenate([[-1.0], np.arange(len(u) + 1) * Ts, [len(u) * Ts + 1.0]])
        for k, drive in enumerate(self.robot.drives):
            commands = np.concatenate([u[:1, k], u[:, k], u[-1:, k]])
            total = np.concatenate([[0.0], np.cumsum(commands * np.diff(knots))])
            for delay in np.unique(delays[:, k]):
                mean = np.diff(np.interp(edges - delay, knots, total)) / np.diff(edges)
                out[delays[:, k] == delay, :, drive.ctrl] = mean
            before = np.clip((delays[:, [k]] - edges[:-1]) / np.diff(edges), 0.0, 1.0)  # share of the step
            out[:, :, drive.ctrl] += earlier[:, [k]] * before
        return out


@contextmanager
def _counted_alone() -> Iterator[None]:
    """Warnings of the simulation are counted, and make a failed run; MuJoCo does not print them and writes no file."""
    usual, quiet = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    quiet.logto_console = quiet.logto_file = False
    mujoco.MjLogConfig.set(quiet)
    try:
        yield
    finally:
        mujoco.MjLogConfig.set(usual)


def _play(y: np.ndarray, width: np.ndarray) -> np.ndarray:
    """y (runs, N, drives) behind a play of `width` (runs, drives): what is read rests until the play is crossed."""
    if not width.any():
        return y
    out, half = y.copy(), width / 2.0
    for k in range(1, y.shape[1]):
        out[:, k] = np.clip(out[:, k - 1], y[:, k] - half, y[:, k] + half)
    return out


def free_run(
    rig: Rig,
    values: np.ndarray,
    u: np.ndarray,
    Ts: float,
    start: np.ndarray,
    posture: Mapping[str, float] = NOWHERE,
) -> np.ndarray:
    """Readings (N, drives) of one run with `values` (P,), from `start` (3, drives), see `Rig.run`."""
    return rig.run(np.atleast_2d(values), u, Ts, start[None], posture)[0]

"""An excitation experiment on the leg bench: one joint, one excitation, one log."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from numbers import Integral, Real

import mujoco
import numpy as np

from sysid import excitations
from sysid.errors import InputError, unknown
from twin.drive import Drive, drive
from twin.geometry import end_angles, middle
from twin.leg import BENCH_LEG, bench, check_joint, check_switches
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.pot import potentiometer

# What an excitation gets where the caller gives nothing. A sweep's half period leaves about 22 % of it as rest at an
# end (the first trials on the paper's protocol); an aprbs holds its levels for a fraction of the travel to all of it.
DEFAULTS: dict[str, dict[str, dict[str, float]]] = {
    "shoulder": {"sweep": {"half_period": 2.0}, "aprbs": {"hold_min": 0.2, "hold_max": 1.5}},
    "thigh": {"sweep": {"half_period": 8.0}, "aprbs": {"hold_min": 0.5, "hold_max": 5.0}},
    "shank": {"sweep": {"half_period": 8.0}, "aprbs": {"hold_min": 0.5, "hold_max": 5.0}},
}
SETTLE = 0.5  # [s] at 0 V before the record starts, for the link to lie against one side of its play
SHORTEST = 10  # samples; a shorter record identifies nothing


@dataclass(frozen=True)
class Experiment:
    """Drive `joint` with `excitation` for `duration` [s], sampled every `Ts` [s], the other two joints held rigidly.

    `seed` draws the excitation and the noise, separately: the same seed gives the same log bit for bit, and switching
    the noise off leaves the voltage as it was. `without` names imperfections to leave out (`twin.IMPERFECTIONS`).
    `options` overrides the excitation's own settings, for example {"amplitude": 6.0}. Every record starts at mid
    stroke: a sweep that started at an end would be periodic from its first sample, and an identified resonance would
    fit that better than the joint does. Without end stops nothing keeps the actuator inside its stroke: give a small
    amplitude. Raises InputError for arguments that do not exist or do not fit.
    """

    joint: str = "thigh"
    excitation: str = "sweep"
    duration: float = 250.0
    Ts: float = 0.1
    seed: int = 1
    without: tuple[str, ...] = ()
    parameters: Parameters | None = None
    options: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_joint(self.joint)
        object.__setattr__(self, "without", check_switches(self.without))
        if self.parameters is None:
            object.__setattr__(self, "parameters", Parameters())
        elif not isinstance(self.parameters, Parameters):
            raise InputError(f"parameters is a {type(self.parameters).__name__}; give a twin.Parameters")
        if isinstance(self.seed, bool) or not isinstance(self.seed, Integral) or self.seed < 0:
            raise InputError(f"seed is {self.seed!r}; give a whole number from 0 up")
        for name in ("Ts", "duration"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Real) or not 0 < value < np.inf:
                raise InputError(f"{name} is {value!r}; give a positive number of seconds")
        steps = self.Ts / TIMESTEP
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6 * steps:
            raise InputError(f"Ts is {self.Ts} s; give a whole number of milliseconds, the step of the simulation")
        if self.N < SHORTEST or abs(self.duration / self.Ts - self.N) > 1e-6 * self.N:
            raise InputError(
                f"duration {self.duration} s is {self.duration / self.Ts:g} samples of {self.Ts} s; give a whole "
                f"number of at least {SHORTEST}"
            )
        self.signal()  # an unknown excitation or option is found here, before the run
        for joint in JOINTS:
            end_angles(self.parameters, joint)  # and so are pins that the actuator cannot span

    @property
    def N(self) -> int:
        """Number of samples."""
        return round(self.duration / self.Ts)

    def signal(self) -> excitations.Excitation:
        """The excitation with the joint's defaults and `options` in it."""
        if self.excitation not in excitations.TABLE:
            raise unknown("excitation", self.excitation, excitations.TABLE)
        assert self.parameters is not None
        settings = {"amplitude": self.parameters["supply_voltage"]}
        settings |= DEFAULTS[self.joint].get(self.excitation, {})
        settings |= self.options
        known = getattr(excitations.TABLE[self.excitation], "__dataclass_fields__", {})
        for name in settings:
            if name not in known:
                raise unknown(f"option of {self.excitation}", name, known)
        return excitations.TABLE[self.excitation](**settings)

    def run(self) -> Log:
        """Simulate and record."""
        assert self.parameters is not None
        p = self.parameters
        draw, noise = (np.random.default_rng(s) for s in np.random.SeedSequence(self.seed).spawn(2))
        u = self.signal().generate(self.N, self.Ts, draw)
        model = bench(self.joint, p, self.without)
        y_true = simulate(model, drive(p, self.joint, self.without), self.joint, u, self.Ts, middle(p, self.joint))
        y = potentiometer(p, self.without).read(y_true, noise)
        return Log(u, y, self.Ts, y_true, self.joint, self._meta())

    def _meta(self) -> dict:
        assert self.parameters is not None
        return {
            "source": "twin",
            "joint": self.joint,
            "excitation": self.excitation,
            "options": vars(self.signal()),
            "duration": self.duration,
            "Ts": self.Ts,
            "seed": int(self.seed),
            "without": list(self.without),
            "parameters_changed": self.parameters.changed(),
            "versions": {name: _version(name) for name in ("qpal", "mujoco", "numpy")},
        }


TIMESTEP = 0.001  # [s], as in the MJCF


def simulate(model: mujoco.MjModel, drive: Drive, joint: str, u: np.ndarray, Ts: float, start: float) -> np.ndarray:
    """Angle between the links (N,) [rad] at each sample, before its voltage u (N,) [V] is applied for Ts [s].

    `model` is a bench of `joint`; `start` [rad] is the drive side's angle. The motor voltage is decided afresh every
    `drive.period`, from a position that is one simulation step old.
    """
    data = mujoco.MjData(model)
    data.qpos[0] = start
    mujoco.mj_step(model, data, round(SETTLE / model.opt.timestep))
    position, index = (data.qpos, 0) if joint == "shoulder" else (data.ten_length, model.tendon(joint + BENCH_LEG).id)
    ctrl, voltage, step = data.ctrl, drive.voltage, mujoco.mj_step
    per_sample, per_tick = round(Ts / model.opt.timestep), max(1, round(drive.period / model.opt.timestep))
    ticks = [min(per_tick, per_sample - k) for k in range(0, per_sample, per_tick)]
    y = np.empty(len(u))
    for k, command in enumerate(u.tolist()):
        y[k] = data.qpos.sum()  # hinge and play
        for nstep in ticks:
            ctrl[0] = voltage(command, position[index])
            step(model, data, nstep)
    return y


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # a checkout on the path, not installed
        return "unknown"

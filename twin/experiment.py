"""An excitation experiment on the leg bench: one joint or all three, one excitation, one log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from numbers import Integral, Real
from typing import Any

import mujoco
import numpy as np

from sysid import excitations
from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError, unknown
from sysid.base.limits import STEPS
from twin.hardware.actuator import MODES, check_rotor
from twin.hardware.linkage import clearance, end_angles, middle
from twin.hardware.potentiometer import SIDES, potentiometer
from twin.log import Log
from twin.parameters import JOINTS, REALISATIONS, Parameters
from twin.plant import slots
from twin.plant.board import circuit, user_data
from twin.plant.leg import BENCH_LEG, bench, check_switches, joints_of, loop_positions
from twin.plant.stepping import TIMESTEP, Run, step

# Which of an excitation's settings a joint gets where the caller gives none: the shoulder crosses its stroke in 1.6 s,
# thigh and shank take 6 s. A sweep's half period then leaves about 22 % of it as rest at an end (the first trials on
# the paper's protocol); an aprbs holds its levels for a fraction of the travel to all of it.
PACE = {"shoulder": "fast", "thigh": "slow", "shank": "slow"}
SETTLE = 0.5  # [s] at rest before the record starts, for the link to lie against one side of its play
SHORTEST = 10  # samples; a shorter record identifies nothing


@checked(deferred=("parameters", "duration", "Ts"))
@dataclass(frozen=True)
class Experiment:
    """Drive `joint` with `excitation` for `duration` [s], sampled every `Ts` [s]; the other joints are held rigidly.

    `joint` "leg" drives all three at once, each with its own realisation of the excitation. `seed` draws the
    excitation, the noise and the lost samples independently: the same seed gives the same log bit for bit, and the
    voltage does not change if the noise is switched off. `without` names imperfections to leave out
    (`twin.IMPERFECTIONS`). `options` overrides the excitation's own settings, for example {"amplitude": 6.0}. Every
    record starts at mid stroke: a sweep from an end would be periodic from its first sample, and an identified
    resonance would fit it better than a model of the joint. Without end stops the actuator can leave its stroke: give
    a small amplitude.

    mode "voltage": the input is the commanded motor voltage, open loop, as in the paper. "servo": the input is the
    reference of the driver's position loop, in potentiometer volts with 0 V at angle 0; the default amplitude and
    offset then cover the middle 80 % of the travel. pot_side "link": the potentiometer reads the link, behind the
    backlash; "drive": it reads the drive. realisation "closed_loop" models the linear actuators as bodies, to check
    the tendon. Raises InputError for arguments that do not exist or do not fit.
    """

    joint: str = "thigh"
    excitation: str = "sweep"
    duration: float = 250.0
    Ts: float = 0.1
    seed: int = 1
    without: tuple[str, ...] = ()
    parameters: Parameters | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    mode: str = "voltage"
    pot_side: str = "link"
    realisation: str = "tendon"

    def __post_init__(self) -> None:
        joints_of(self.joint)
        object.__setattr__(self, "without", check_switches(self.without))
        if self.parameters is None:
            object.__setattr__(self, "parameters", Parameters())
        elif not isinstance(self.parameters, Parameters):
            raise InputError(f"parameters is a {type(self.parameters).__name__}; give a twin.Parameters")
        if isinstance(self.seed, bool) or not isinstance(self.seed, Integral) or self.seed < 0:
            raise InputError(f"seed is {self.seed!r}; give a whole number of at least 0")
        for name, choices in (("mode", MODES), ("pot_side", SIDES), ("realisation", REALISATIONS)):
            if getattr(self, name) not in choices:
                raise unknown(name.replace("_", " "), getattr(self, name), choices)
        self._check_times()
        for joint, signal in zip(self.joints, self.signals(), strict=True):  # unknown excitations and options end here
            self._check_level(joint, signal)
        for joint in JOINTS:
            end_angles(self.p, joint)  # and so are pins that the actuator cannot span
            check_rotor(self.p, joint)
        if "contact" not in self.without and clearance(self.p) < 0.0:
            raise InputError(
                f"at mid stroke the foot stands {-1e3 * clearance(self.p):.0f} mm inside the floor; raise bench_height "
                f"({self.p['bench_height']:g} m) by as much, or leave contact out"
            )

    def _check_times(self) -> None:
        """Raises InputError for a duration or sampling time that the simulation does not take."""
        for name in ("Ts", "duration"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Real) or not 0 < float(value) < np.inf:
                raise InputError(f"{name} is {value!r}; give a positive number of seconds")
        if self.duration > STEPS * TIMESTEP:
            raise InputError(f"duration is {self.duration:g} s; give at most {STEPS * TIMESTEP:g} s, {STEPS:,} steps")
        steps = self.Ts / TIMESTEP
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6 * steps:
            raise InputError(f"Ts is {self.Ts} s; give a whole number of milliseconds, the step of the simulation")
        if self.N < SHORTEST or abs(self.duration / self.Ts - self.N) > 1e-6 * self.N:
            raise InputError(
                f"duration {self.duration} s is {self.duration / self.Ts:g} samples of {self.Ts} s; give a whole "
                f"number of at least {SHORTEST}"
            )

    def _check_level(self, joint: str, signal: excitations.Excitation) -> None:
        """Raises InputError if the signal exceeds the supply voltage or the potentiometer's range."""
        largest = abs(signal.amplitude) + abs(getattr(signal, "offset", 0.0))
        servo = self.mode == "servo"
        limit, source = (self.p["pot_supply"] / 2, "potentiometer") if servo else (self.p["supply_voltage"], "supply")
        if largest > limit * (1 + 1e-9):
            raise InputError(
                f"{self.excitation} on the {joint} reaches {largest:g} V, the {source} {limit:g} V; give a smaller "
                "amplitude or offset"
            )

    @property
    def p(self) -> Parameters:
        """The parameters; nominal if none were given."""
        assert self.parameters is not None
        return self.parameters

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that are driven."""
        return joints_of(self.joint)

    @property
    def N(self) -> int:
        """Number of samples."""
        return round(self.duration / self.Ts)

    def signals(self) -> tuple[excitations.Excitation, ...]:
        """The excitation of each driven joint, with the joint's defaults and `options`."""
        return tuple(self._signal(joint) for joint in self.joints)

    def signal(self) -> excitations.Excitation:
        """The excitation of the first driven joint."""
        return self.signals()[0]

    def _signal(self, joint: str) -> excitations.Excitation:
        """The excitation of `joint`: its defaults, then `options`; raises InputError for unknown ones."""
        if self.excitation not in excitations.TABLE:
            raise unknown("excitation", self.excitation, excitations.TABLE)
        kind = excitations.TABLE[self.excitation]
        names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
        settings: dict[str, Any] = {"amplitude": self.p["supply_voltage"]}
        if self.mode == "servo":
            low, high = (angle * potentiometer(self.p).scale for angle in end_angles(self.p, joint))
            settings = {"amplitude": 0.4 * (high - low), "offset": 0.5 * (high + low)}
            if "offset" not in names:
                raise InputError(f"{self.excitation} has no offset, which servo mode needs; take another excitation")
        settings |= kind.paces[PACE[joint]]
        settings |= self.options
        for name in settings:
            if name not in names:
                raise unknown(f"option of {self.excitation}", name, names)
        return kind(**settings)

    def run(self) -> Log:
        """Simulate and record."""
        return run_all([self])[0]

    def commands(self) -> np.ndarray:
        """The excitations (N, joints) [V]."""
        draws = self._generators("excitation")
        pairs = zip(self.signals(), draws, strict=True)
        return np.column_stack([signal.generate(self.N, self.Ts, rng) for signal, rng in pairs])

    @checked
    def generator(self, purpose: str) -> np.random.Generator:
        """The generator of the first driven joint's "excitation", "noise" or "sampling"."""
        if purpose not in _DRAWS:
            raise unknown("draw", purpose, _DRAWS)
        return self._generators(purpose)[0]

    def _generators(self, purpose: str) -> list[np.random.Generator]:
        """One generator for each driven joint; it does not depend on which other joints are driven."""
        roots = np.random.SeedSequence(self.seed).spawn(len(_DRAWS))[_DRAWS.index(purpose)]
        if self.joint in JOINTS:
            return [np.random.default_rng(roots)]
        return [np.random.default_rng(s) for s in roots.spawn(len(JOINTS))]

    @checked
    def prepare(
        self, model: mujoco.MjModel | None = None, u: np.ndarray | None = None, start: Mapping[str, float] | None = None
    ) -> Run:
        """What `step` needs to simulate the experiment; `model` if the caller has compiled it already.

        `u` (n, joints) [V] replaces the excitation, and `start` [rad] replaces mid stroke for the joints that it names.
        """
        p = self.p
        if model is None:
            model = bench(self.joint, p, self.without, self.realisation)
        circuits = [circuit(p, joint, self.without) for joint in self.joints]
        on_link, servo = self.pot_side == "link", self.mode == "servo"
        angles = {joint: middle(p, joint) for joint in self.joints} | dict(start or {})
        commands = self.commands() if u is None else u
        time_errors = potentiometer(p, self.without).times(len(commands), self.Ts, self._generators("sampling")[0])
        return Run(
            model,
            user_data(model, circuits, servo, on_link, self.seed),
            _start(model, p, angles),
            commands,
            np.array([c.pot.scale * angles[j] if servo else 0.0 for c, j in zip(circuits, self.joints, strict=True)]),
            p.switched_off(self.without)["delay"],
            time_errors,
        )

    @checked(deferred=("shown",))  # NaN where MuJoCo gave up
    def record(self, run: Run, shown: np.ndarray) -> Log:
        """The log of a finished run from the board outputs (N, joints, COLUMNS)."""
        if np.ndim(shown) != 3 or len(shown) != len(run.commands):
            raise InputError(f"shown is {short_text(shown)}; give the outputs of this run, as `step` returns them")
        pot, clean = potentiometer(self.p, self.without), shown[:, :, slots.READING]
        read = [pot.read(column, rng) for column, rng in zip(clean.T, self._generators("noise"), strict=True)]
        u, y, y_true = run.commands, np.column_stack(read), clean
        if self.joint in JOINTS:
            u, y, y_true = u[:, 0], y[:, 0], y_true[:, 0]
        return Log(u, y, self.Ts, y_true, self.joint, self.meta())

    def meta(self) -> dict:
        """What a log keeps of the experiment."""
        return {
            "source": "twin",
            "joint": self.joint,
            "excitation": self.excitation,
            "options": vars(self.signal()) if self.joint in JOINTS else [vars(signal) for signal in self.signals()],
            "duration": self.duration,
            "Ts": self.Ts,
            "seed": int(self.seed),
            "without": list(self.without),
            "mode": self.mode,
            "pot_side": self.pot_side,
            "realisation": self.realisation,
            "parameters_changed": self.p.changed(),
            "versions": {name: _version(name) for name in ("qpal", "mujoco", "numpy")},
        }


_DRAWS = ("excitation", "noise", "sampling")


def run_all(experiments: Sequence[Experiment], threads: int = 1) -> list[Log]:
    """Logs of experiments with the same joint, duration, Ts and realisation, simulated in parallel.

    The logs equal those of `run` bit for bit.
    """
    runs = prepare_runs(experiments)
    outputs = step(runs, experiments[0].Ts, SETTLE, threads)
    return [experiment.record(run, rows) for experiment, run, rows in zip(experiments, runs, outputs, strict=True)]


def prepare_runs(
    experiments: Sequence[Experiment], u: np.ndarray | None = None, starts: Sequence[Mapping[str, float]] | None = None
) -> list[Run]:
    """The simulations of experiments with the same joint and realisation; each different model is compiled once.

    u and starts [rad] as in `Experiment.prepare`, with one mapping for each experiment.
    """
    models: dict[tuple, mujoco.MjModel] = {}
    runs = []
    for k, experiment in enumerate(experiments):
        key = (experiment.joint, experiment.realisation, experiment.without, tuple(experiment.p.values.values()))
        if key not in models:
            models[key] = bench(experiment.joint, experiment.p, experiment.without, experiment.realisation)
        runs.append(experiment.prepare(models[key], u, None if starts is None else starts[k]))
    return runs


def respond(experiment: Experiment, u: np.ndarray, start: Mapping[str, float] | None = None) -> np.ndarray:
    """The board outputs (N, joints, COLUMNS) for `u` (N, joints) [V] in place of the experiment's excitation.

    See `twin.plant.slots` for the columns. `start` [rad] has the drive sides that do not start at mid stroke.
    """
    return step([experiment.prepare(u=u, start=start)], experiment.Ts, SETTLE)[0]


def _start(model: mujoco.MjModel, p: Parameters, angles: Mapping[str, float]) -> np.ndarray:
    """qpos (nq,) of a bench with its drive sides at `angles` [rad], backlash centred and closed loops closed."""
    qpos = np.zeros(model.nq)
    names = {model.joint(i).name for i in range(model.njnt)}
    for joint, angle in angles.items():
        qpos[model.joint(joint + BENCH_LEG).qposadr[0]] = angle
        if f"{joint}_rod{BENCH_LEG}" in names:
            for part, value in zip(("cylinder", "rod"), loop_positions(p, joint, angle), strict=True):
                qpos[model.joint(f"{joint}_{part}{BENCH_LEG}").qposadr[0]] = value
    return qpos


@cache  # looking it up takes as long as a second of a record
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # a checkout on the path, not installed
        return "unknown"

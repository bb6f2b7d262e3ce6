"""The twin driven with the input of a log, from the state in which the log begins."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from twin.experiment import SETTLE, Experiment, prepare_runs
from twin.hardware.linkage import end_angles
from twin.hardware.potentiometer import potentiometer
from twin.imperfections import of_group
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.plant import slots
from twin.plant.added import NOTHING, Added
from twin.plant.stepping import TIMESTEP, attempt

# A follower gives what the potentiometer would read, so that many parameters are compared on equal terms.
QUIET = tuple(name for name in of_group("sensor") if name != "nonlinearity")
VISIBLE = float(np.deg2rad(0.05))  # RMS: smaller differences of a leg matter to nobody
HELD = 1e-9  # of a step: a sample that falls on the end of a simulation step belongs to the next one


@checked(late=True)
@dataclass(frozen=True)
class Follower:
    """The twin's `joint` under the input of `log`, which is held from sample to sample.

    The joint starts at rest, by default at the log's first angle. Any sampling time is allowed: the command changes at
    the simulation step in which its sample falls. `without`, `pot_side` and `realisation` are those of an `Experiment`;
    noise, ADC, jitter and lost samples are always left out. Raises InputError for a joint that the log does not have.
    """

    log: Log
    joint: str
    without: tuple[str, ...] = ()
    pot_side: str = "link"
    realisation: str = "tendon"
    threads: int = 2
    u: np.ndarray = field(init=False, repr=False)
    y: np.ndarray = field(init=False, repr=False)
    _asked: tuple[str, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.joint not in JOINTS:
            raise unknown("joint", self.joint, JOINTS)
        data = self.log.io(self.joint if self.log.joint else None)
        object.__setattr__(self, "u", data.u.ravel())
        object.__setattr__(self, "y", data.y.ravel())
        object.__setattr__(self, "_asked", tuple(self.without))
        object.__setattr__(self, "without", tuple(dict.fromkeys((*self.without, *QUIET))))
        if self.log.Ts < TIMESTEP:
            raise InputError(
                f"the log is sampled every {self.log.Ts:g} s, faster than the simulation's step of {TIMESTEP:g} s; "
                "resample it first"
            )

    @checked(late=True)
    def readings(
        self,
        parameters: Sequence[Parameters],
        starts: Sequence[float] | np.ndarray | None = None,
        shifts: Sequence[float] | np.ndarray | None = None,
        which: Sequence[int] | None = None,
    ) -> np.ndarray:
        """Angles (runs, N) [rad] read by the potentiometer without noise, one row for each of `parameters`.

        `starts` (runs,) [rad]: angle of the drive side at the first sample; one outside the stroke is moved to the end.
        `shifts` (runs,) [s]: additional delay of the reading, 0 or more, in addition to the parameter `delay`; it is
        continuous, where the board sees commands only once in a period. With `which` (rows,) there is one row for each
        entry: the simulation of that number with its own shift, so that several shifts of one leg are simulated once.
        Rows of failed simulations are NaN.
        """
        which = range(len(parameters)) if which is None else which
        shifts = np.zeros(len(which)) if shifts is None else np.asarray(shifts, dtype=float)
        _check_each("shifts", shifts, len(which), "rows")
        courses = self.courses(parameters, starts)
        return np.stack([self.sample_course(courses[k], shift) for k, shift in zip(which, shifts, strict=True)])

    @checked(late=True)
    def courses(
        self,
        parameters: Sequence[Parameters],
        starts: Sequence[float] | np.ndarray | None = None,
        added: Sequence[Added] | None = None,
    ) -> np.ndarray:
        """The same readings (runs, steps) [rad] at every simulation step, for `sample_course`.

        `added` (runs): what the drive of each run has beside its parameters. Where that is something, rows whose link
        would touch something are NaN too.
        """
        runs = len(parameters)
        if not runs:
            raise InputError("no parameters are given; give those of one run or more")
        starts = np.full(runs, self.y[0]) if starts is None else np.asarray(starts, dtype=float)
        _check_each("starts", starts, runs, "parameters")
        experiments = [self._experiment(p, self._steps) for p in parameters]
        places = [
            float(np.clip(start, *end_angles(p, self.joint))) for p, start in zip(parameters, starts, strict=True)
        ]
        tables = [NOTHING] * runs if added is None else list(added)
        with ThreadPoolExecutor(max(self.threads, 1)) as pool:
            courses = list(pool.map(self._course, experiments, places, tables))
        others = [k for k, course in enumerate(courses) if course is None]
        if others:
            angles = [{self.joint: places[k]} for k in others]
            prepared = prepare_runs([experiments[k] for k in others], self.commands[:, None], angles)
            outputs, _ = attempt(prepared, TIMESTEP, SETTLE, self.threads)
            for k, output in zip(others, outputs, strict=True):
                courses[k] = output[:, 0, slots.READING]
        return np.stack([course for course in courses if course is not None])

    def _course(self, e: Experiment, start: float, added: Added) -> np.ndarray | None:
        """The readings (steps,) of one run; None where only MuJoCo knows them: closed loops and contacts."""
        unknown_course = None if added is NOTHING else np.full(self._steps, np.nan)
        if e.realisation != "tendon":
            return unknown_course
        from twin.plant.mechanics import course  # compiled code, loaded by those who step

        servo, on_link = e.mode == "servo", e.pot_side == "link"
        found = course(e.p, e.joint, e.without, self.commands, start, SETTLE, servo, on_link, e.seed, added)
        return unknown_course if found is None else found

    @checked(late=True)
    def sample_course(self, course: np.ndarray, shift: float = 0.0) -> np.ndarray:
        """Readings (N,) [rad] at the log's samples from one of `courses` (steps,), `shift` [s] later; the first and
        the last reading stand beyond the ends."""
        return np.interp(self.log.t - shift, np.arange(len(course)) * TIMESTEP, course)

    @checked(late=True)
    def record(self, parameters: Parameters | None = None, seed: int = 1, start: float | None = None) -> Log:
        """The log that the twin itself writes under this input: with noise, ADC, jitter and lost samples of `seed`.

        Imperfections in `without` as the follower was given it; `start` as in `readings`. With the parameters, the seed
        and the start of an `Experiment`, its log comes back.
        """
        p, N, Ts = parameters or Parameters(), self.log.N, self.log.Ts
        experiment = replace(self._experiment(p, self._steps), seed=seed, without=self._asked)
        angle = float(np.clip(self.y[0] if start is None else start, *end_angles(p, self.joint)))
        (run,) = prepare_runs([experiment], self._commands(), [{self.joint: angle}])
        outputs, trouble = attempt([replace(run, late=np.zeros(self._steps))], TIMESTEP, SETTLE, self.threads)
        if trouble[0]:
            raise InputError(f"the twin with these parameters cannot follow the log ({trouble[0]}); change --params")
        pot = potentiometer(p, self._asked)
        time_errors = pot.times(N, Ts, experiment.generator("sampling"))
        fine = np.arange(self._steps) * TIMESTEP
        clean = np.interp(self.log.t + time_errors, fine, outputs[0, :, 0, slots.READING])
        meta = experiment.meta() | {"excitation": "log", "options": {}, "duration": N * Ts, "Ts": Ts, "start": angle}
        return Log(self.u, pot.read(clean, experiment.generator("noise")), Ts, clean, self.joint, meta)

    @property
    def _steps(self) -> int:
        return int(np.ceil(self.log.N * self.log.Ts / TIMESTEP)) + 1

    @cached_property
    def commands(self) -> np.ndarray:
        """The input (steps,) [V] at every simulation step."""
        return self._commands()[:, 0]

    def _commands(self) -> np.ndarray:
        """The input (steps, 1) at every simulation step."""
        indices = np.floor(np.arange(self._steps) * TIMESTEP / self.log.Ts + HELD).astype(int)
        return self.u[np.minimum(indices, self.log.N - 1)][:, None]

    def _experiment(self, parameters: Parameters, steps: int) -> Experiment:
        """The experiment that lasts `steps` simulation steps with these parameters; its own signal is not used."""
        return Experiment(
            self.joint,
            excitation="staircase" if self.log.mode == "servo" else "sweep",  # never generated
            duration=steps * TIMESTEP,
            Ts=TIMESTEP,
            without=self.without,
            parameters=parameters,
            mode=self.log.mode,
            pot_side=self.pot_side,
            realisation=self.realisation,
        )


def _check_each(name: str, values: np.ndarray, count: int, subject: str) -> None:
    if values.shape != (count,):
        raise InputError(f"{name} has shape {values.shape}; give one number for each of the {count} {subject}")

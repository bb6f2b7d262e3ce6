"""The twin driven with the input of a log, from the state in which the log begins."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError, unknown
from twin.experiment import SETTLE, Experiment, prepared
from twin.hardware.linkage import end_angles
from twin.imperfections import of_group
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.plant import slots
from twin.plant.stepping import TIMESTEP, attempt

# A follower gives what the potentiometer would read, so that many parameters are compared on equal terms.
QUIET = tuple(name for name in of_group("sensor") if name != "nonlinearity")
HELD = 1e-9  # of a step: a sample that falls on the end of a simulation step belongs to the next one


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

    def __post_init__(self) -> None:
        if self.joint not in JOINTS:
            raise unknown("joint", self.joint, JOINTS)
        data = self.log.io(self.joint if self.log.joint else None)
        object.__setattr__(self, "u", data.u.ravel())
        object.__setattr__(self, "y", data.y.ravel())
        object.__setattr__(self, "without", tuple(dict.fromkeys((*self.without, *QUIET))))
        if self.log.Ts < TIMESTEP:
            raise InputError(
                f"the log is sampled every {self.log.Ts:g} s, faster than the simulation's step of {TIMESTEP:g} s; "
                "resample it first"
            )

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
        runs = len(parameters)
        which = range(runs) if which is None else which
        starts = np.full(runs, self.y[0]) if starts is None else np.asarray(starts, dtype=float)
        shifts = np.zeros(len(which)) if shifts is None else np.asarray(shifts, dtype=float)
        commands = self._commands()
        experiments = [self._experiment(p, len(commands)) for p in parameters]
        places = [
            {self.joint: float(np.clip(start, *end_angles(p, self.joint)))}
            for p, start in zip(parameters, starts, strict=True)
        ]
        shown, _ = attempt(prepared(experiments, commands, places), TIMESTEP, SETTLE, self.threads)
        read = shown[:, :, 0, slots.READING]
        fine, wanted = np.arange(len(commands)) * TIMESTEP, self.log.t
        return np.stack([np.interp(wanted - shift, fine, read[k]) for shift, k in zip(shifts, which, strict=True)])

    def _commands(self) -> np.ndarray:
        """The input (steps, 1) at every simulation step."""
        steps = int(np.ceil(self.log.N * self.log.Ts / TIMESTEP)) + 1
        at = np.floor(np.arange(steps) * TIMESTEP / self.log.Ts + HELD).astype(int)
        return self.u[np.minimum(at, self.log.N - 1)][:, None]

    def _experiment(self, parameters: Parameters, steps: int) -> Experiment:
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

"""The next experiment on a joint, designed on its first fit: an input that shows chosen values, and what it would tell.

The design leaves as little as possible to the first fit. Before every slow part the joint runs to its lower end, or
where none is known it stays near the middle of what was seen; levels and times are fitted to the identified speed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.base.quantities import display_quantity
from sysid.blocks import CoastingPlay, Play, ServoMotor
from sysid.blocks.motor import LONGEST
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.joint_parts import is_joint, lift_theta, motor_of, sub
from sysid.estimation.result import Fit
from sysid.joint.clock import Clock
from sysid.joint.course import LONG, TOPS, Course
from sysid.joint.outlook import distant_prediction, shortfalls, unseen_ends, weak_inputs
from sysid.joint.sampling import LONGEST_DELAY, rate_needed
from sysid.joint.stops import reading_noise
from sysid.joint.use import Use, add_parts_for_use
from sysid.joint.values import JointValue, joint_values
from sysid.model.chain import Chain

TARGETS = {
    "ends": ("end_low", "end_high", "speed_per_volt"),
    "breakaway": ("breakaway_up", "breakaway_down"),
    "backlash": ("backlash",),
}
PURPOSES = {
    "ends": "from one end stop to the other at different levels",
    "breakaway": "pulses from rest, each a little larger, until the joint starts",
    "backlash": "slow reversals: the drive crosses the backlash before the link follows",
    "use": "a piece of the input of use itself",
}
# Every round has all parts, so that either half of the record shows what the other does; slow parts are at these shares
# of the way between the ends.
PLACES = (0.4, 0.65)
REVERSALS = 6  # of the drive at each place, to and fro
SLOW = (0.2, 0.5)  # shares of the largest level, in turn: at one speed a backlash looks like a delay
# Pairs of ways from end to end: the share of the largest level, and the time as a share of the way's own, from and to.
# Some rest long at the end, some are turned on the way, and some just after they arrive, where a jam shows.
RESTING, TURNING, ARRIVING = (LONG, 1.6), (0.4, 0.9), (1.02, 1.12)
PAIRS = (
    ((1.0, *RESTING), (0.85, *ARRIVING), (0.7, *TURNING), (0.65, *RESTING)),
    ((0.8, *RESTING), (0.95, *ARRIVING), (0.55, *TURNING), (0.9, *RESTING)),
)
GUESSED_PLAY = 0.01  # of the way: width of a backlash that the first fit does not have


@dataclass(frozen=True)
class Phase:
    """A part of the experiment: its name, its samples from `start` to `stop`, and what it is for."""

    name: str
    start: int
    stop: int
    why: str


@dataclass(frozen=True)
class Design:
    """An input u (N,) for the next experiment, and the output y (N,) that the fit predicts for it.

    `fastest` [y/s] is the largest predicted speed, and so the hardest that the joint may meet an end. `now` are the
    joint's values from the first record, `then` those from a simulated record of this experiment: they hold if the
    real joint is like the fit. `use`: what it brings for an input of the user's, if it was designed for one; `no_use`
    says why it was not, where one was given.
    """

    targets: tuple[str, ...]
    u: np.ndarray
    y: np.ndarray
    Ts: float
    phases: tuple[Phase, ...]
    fastest: float
    now: tuple[JointValue, ...]
    then: tuple[JointValue, ...]
    units: tuple[str, str] = ("", "")
    notes: tuple[str, ...] = ()
    use: Use | None = None
    no_use: str = ""

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self.u) * self.Ts

    def as_dict(self) -> dict[str, Any]:
        """The summary, ready for JSON."""
        return {
            "for": list(self.targets),
            "duration": self.duration,
            "Ts": self.Ts,
            "largest_input": float(np.abs(self.u).max()),
            "fastest": self.fastest,
            "phases": [vars(p) | {"start": p.start * self.Ts, "stop": p.stop * self.Ts} for p in self.phases],
            "now": [vars(v) for v in self.now],
            "then": [vars(v) for v in self.then],
            "notes": list(self.notes),
            "use": None if self.use is None else {"deviation": self.use.deviations, "steps": self.use.steps},
            "no_use": self.no_use or None,
        }


@checked(deferred=("volts", "strike", "Ts"))
def design(
    fit: Fit,
    data: IOData,
    targets: Sequence[str] = tuple(TARGETS),
    volts: float | None = None,
    strike: float | None = None,
    seed: int = 0,
    Ts: float | None = None,
    complete: bool = False,
    to_stops: bool = False,
    use: np.ndarray | None = None,
    clock: Clock | None = None,
) -> Design:
    """The next experiment on the joint of `fit`, an `actuated_joint` fitted to `data`, for values of `TARGETS`.

    volts: largest input [unit of u], that of `data` if not given. strike [y/s]: speed that the joint must not exceed
    anywhere, so that it meets no end harder. Ts [s]: sampling time of the next record; if not given, that of `data`, or
    a half, a quarter or a fifth of it, so that lag and delay together last three samples. `complete` leaves out of the
    expected intervals what every model of a joint lacks. `to_stops`: the joint has a stop each way and may run into it;
    otherwise the input keeps it within the range of `data` where `data` shows no stop. `use` (N,), an input every
    `data.Ts`: the experiment is made of the parts for `targets`, and pieces of this input, that shrink the band of the
    free run over it most for their time (`sysid.joint.use`), in samples of `data.Ts`, for a fit to both records; it has
    those that are found before the `clock` is late, and where there are none it is that without `use`. Raises
    InputError for a fit without a motor, an unknown target, a sampling time that does not suit, a joint that does not
    move under these limits, and the errors of `sysid.joint_values`.
    """
    targets = tuple(targets)
    for name in targets:
        if name not in TARGETS:
            raise unknown("value to design for", name, TARGETS)
    if not targets:
        raise InputError(f"no value to design for; give some of {', '.join(TARGETS)}")
    if not is_joint(fit.model):
        raise InputError(f"a {fit.model.structure} has no motor; design the next experiment on an actuated_joint")
    if isinstance(motor_of(fit.model), ServoMotor):
        raise InputError("the joint is a servo, whose input is a goal; design records of a joint driven by voltage")
    for name, value in (("volts", volts), ("strike", strike)):
        if value is not None and not 0.0 < value < np.inf:
            raise InputError(f"{name} is {value}; give a positive number, or leave it out")
    top = float(np.abs(data.u).max()) if volts is None else volts
    rate = data.Ts if use is not None and Ts is None else Ts  # both records are identified together
    work = _Plan(Course.of(fit, data, top, strike, _sampling(fit, rate), to_stops), np.random.default_rng([seed, 14]))
    course, for_use = work.course, None
    parts = [(name, partial(_PARTS[name], work, k)) for k in range(len(PLACES)) for name in TARGETS if name in targets]
    if use is None:
        for _, run in parts:
            run()
    else:
        try:
            for_use, added = add_parts_for_use(fit, data, use, course, parts, reading_noise(data), clock or Clock())
        except InputError as error:
            plain = design(fit, data, targets, volts, strike, seed, Ts, complete, to_stops)
            return replace(plain, no_use=f"{error}. The experiment is that without this input")
        work.phases[:] = [Phase(name, first, last, PURPOSES[name]) for name, first, last in added]
    u, y = course.inputs(), course.outputs()
    value_names = [name for target in targets for name in TARGETS[target]]
    current_values, (expected_values, notes) = (
        joint_values(fit, data=data),
        _expected_values(fit, data, course, targets, complete, use is not None),
    )
    return Design(
        targets,
        u,
        y,
        course.Ts,
        tuple(work.phases),
        float(np.abs(np.diff(y)).max()) / course.Ts,
        current_values,
        expected_values,
        (data.u_unit, data.y_unit),
        (
            *unseen_ends(course, data),
            *distant_prediction(course, y, data),
            *weak_inputs(course, data.u_unit),
            *notes,
            *(shortfalls(value_names, current_values, expected_values, course.Ts) if use is None else ()),
        ),
        for_use,
    )


@dataclass
class _Plan:
    """A course that grows, and its phases."""

    course: Course
    rng: np.random.Generator
    phases: list[Phase] = field(default_factory=list)

    def phase(self, name: str, run: Callable[[], None]) -> None:
        start = self.course.N
        run()
        self.phases.append(Phase(name, start, self.course.N, PURPOSES[name]))


def _add_strokes(work: _Plan, k: int) -> None:
    """The experiment on ends and speed per volt: from end to end at different levels."""
    course, rng = work.course, work.rng

    def run() -> None:
        for share, shortest, longest in PAIRS[k]:
            for way in (-1, 1):
                course.add_stroke(way, share * rng.uniform(0.9, 1.0), rng.uniform(shortest, longest))
        course.add_rest()

    work.phase("ends", run)


def _add_pulses(work: _Plan, k: int) -> None:
    """The experiment on break-away: rising pulses from rest, up and down in turn, each the way that the joint came.

    Each height of the pulses is a phase: a rig with little time left plays some of them.
    """
    course = work.course

    def run(top: float) -> None:
        for way in (1, -1):
            course.add_approach(PLACES[k], way)
            course.add_rest()
            for level in course.rising_levels(way, top):
                course.add_level(level, course.pulse_samples)
                course.add_level(course.resting_input, course.observation_samples)
        course.add_rest()

    for top in TOPS:
        work.phase("breakaway", partial(run, top))


def _add_reversals(work: _Plan, k: int) -> None:
    """The experiment on backlash: slow reversals of the drive at one place."""
    course = work.course

    def run() -> None:
        course.add_approach(PLACES[k])
        for n in range(2 * REVERSALS):
            way, share = 1 if n % 2 == 0 else -1, SLOW[n // 2 % 2]
            course.add_reversal(way, share)
        course.add_rest()

    work.phase("backlash", run)


_PARTS = {"ends": _add_strokes, "breakaway": _add_pulses, "backlash": _add_reversals}


def _sampling(fit: Fit, Ts: float | None) -> float:
    """Sampling time [s] of the next record."""
    if Ts is None:
        return fit.Ts / rate_needed(fit)
    motor = motor_of(fit.model)
    least = fit.Ts * max(1.0 / LONGEST_DELAY, motor.value(fit.model.part(fit.theta, motor), "delay") / LONGEST)
    if not least <= Ts <= fit.Ts:
        raise InputError(
            f"the sampling time of the next record is {Ts:g} s; give {least:.3g} to {fit.Ts:g} s, that of the first"
        )
    return Ts


def _expected_values(
    fit: Fit, data: IOData, course: Course, targets: tuple[str, ...], complete: bool, both: bool
) -> tuple[tuple[JointValue, ...], list[str]]:
    """The values from a simulated record of the experiment, together with the first record if `both`."""
    (chain, theta), notes, u, y = course.joint(), list[str](), course.inputs(), course.outputs()
    if "backlash" in targets and not any(isinstance(b, Play | CoastingPlay) for b in chain.blocks):
        width = GUESSED_PLAY * float(np.ptp(data.y))
        place = len(chain.blocks) - (chain.blocks[-1].role == "sensor")
        play = Play(role="play")
        richer = sub(chain, (*chain.blocks[:place], play, *chain.blocks[place:]))
        theta, chain = lift_theta(chain, theta, richer, {"play.width": width}), richer
        prediction = np.asarray(chain.simulate(theta, u)).ravel()
        y = prediction + (y[0] - prediction[0])
        size = display_quantity("backlash", data.y_unit or "")
        width_in_words = f"{width * size.factor:.3g} {size.unit}".rstrip()
        notes.append(
            f"no backlash is known yet; the prediction has one of {width_in_words}, to test whether it would show"
        )
    record = IOData(u, y, course.Ts)
    return values_of_simulated(chain, theta, record, data, fit.criteria.mse, complete, both), notes


def values_of_simulated(
    chain: Chain, theta: np.ndarray, record: IOData, data: IOData, mse: float, complete: bool, both: bool
) -> tuple[JointValue, ...]:
    """The values from a simulated record with noise of variance `mse`, together with the real `data` if `both`."""
    noise = np.sqrt(mse) * np.random.default_rng(0).standard_normal(record.y.shape)
    record = _with_names(replace(record, y=record.y + noise), data)
    record = IOData.merge(data, record) if both else record
    refit = fit_chain(chain, record, start=np.array(theta), search="lm")
    return joint_values(refit, data=record, complete=complete)


def _with_names(record: IOData, model_record: IOData) -> IOData:
    """The record with the names and units of another."""
    return replace(
        record,
        u_name=model_record.u_name,
        y_name=model_record.y_name,
        u_unit=model_record.u_unit,
        y_unit=model_record.y_unit,
    )

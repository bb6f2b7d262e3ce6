"""From a servo on a bus to values: drawn goals, identify all logs, the goals that would tell most of what is open."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.design import values_of_simulated
from sysid.joint.posterior import fit_joint
from sysid.joint.values import JointValue, joint_values
from sysid.structures import ServoJoint
from twin.log import Log
from twin.rig.auto import LEAST, Campaign, Round
from twin.rig.bus.line import Bus
from twin.rig.bus.recording import Recording, log_of
from twin.rig.bus.registers import Model
from twin.rig.bus.run import check_goals, play
from twin.rig.bus.servo import Servo, about, rest
from twin.rig.run import Input

# What a servo's values may be; those of its record are asked. A gain that was read from the servo is known.
ASKED = ("speed_full_drive", "time_constant", "delay", "lag_and_delay", "coulomb_up", "coulomb_down", "kp", "kd")
TS = 0.02  # [s]: a bus at its usual rate takes 2 to 5 ms for a goal and a reading
SECONDS = 40.0  # of an experiment
SWINGS = 20.0  # [s] of a load with its torque off, at most
WITHIN = 0.95  # of the way between the soft limits


def goals_of(kind: str, low: float, high: float, rng: np.random.Generator) -> np.ndarray:
    """Goals (N,) [rad] of an experiment between `low` and `high`: one of `KINDS`."""
    return KINDS[kind](low, high, rng)


def _held(levels: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Levels, each for its time, until the experiment is over."""
    return np.repeat(levels, np.round(seconds / TS).astype(int))[: round(SECONDS / TS)]


def _steps(low: float, high: float, rng: np.random.Generator) -> np.ndarray:
    """Far and near steps anywhere: the speed at full drive, the time constant and the load."""
    return _held(rng.uniform(low, high, 160), rng.uniform(0.25, 0.8, 160))


def _small_steps(low: float, high: float, rng: np.random.Generator) -> np.ndarray:
    """Short steps at places that wander: starts against friction, below the largest drive."""
    way = np.cumsum(rng.choice([-1.0, 1.0], 160) * rng.uniform(0.01, 0.05, 160)) * (high - low)
    way += rng.uniform(0.0, 2.0 * (high - low))
    return _held(low + np.abs((way % (2.0 * (high - low))) - (high - low)), rng.uniform(0.25, 0.8, 160))


def _ramps(low: float, high: float, rng: np.random.Generator) -> np.ndarray:
    """Slow ways between places: friction in motion, both ways."""
    places, pieces, N = rng.uniform(low, high, 40), list[np.ndarray](), round(SECONDS / TS)
    for first, second in pairwise(places):
        speed = rng.uniform(0.05, 0.4) * (high - low)
        pieces.append(np.linspace(first, second, max(round(abs(second - first) / speed / TS), 2)))
    return np.concatenate(pieces)[:N]


def _reversals(low: float, high: float, rng: np.random.Generator) -> np.ndarray:
    """Fast steps to and fro about places: the time constant, the delay and the derivative gain."""
    middle, size = rng.uniform(low, high, 40), 0.1 * (high - low)
    ways = np.clip(np.concatenate([place + size * np.array([1.0, -1.0] * 4) for place in middle]), low, high)
    return _held(ways, rng.uniform(0.1, 0.2, len(ways)))


KINDS: dict[str, Callable[[float, float, np.random.Generator], np.ndarray]] = {
    "steps": _steps,
    "small steps": _small_steps,
    "slow ramps": _ramps,
    "fast reversals": _reversals,
}


def campaign(
    bus: Bus,
    servo: Servo,
    seed: int = 0,
    most: int = 3,
    budget: float = 600.0,
    step: Callable[[str], None] = lambda name: None,
    share: Callable[[float], None] = lambda share: None,
    keep: Callable[[int, Log, Recording], object] = lambda number, log, recording: None,
) -> Campaign:
    """Experiments on a servo, at most `most` and `budget` [s] together, until every value of its joint is determined.

    All logs are identified together. The next goals are those of the kind whose simulated record would determine most
    of the open values, and most narrowly. `step`, `share` and `keep` are those of `twin.rig.auto.campaign`. A run that
    ends early and leaves less than `LEAST` s, and Ctrl-C, end it with what is known until then.
    """
    rng, logs, known = np.random.default_rng([seed, 71]), list[Log](), about(bus, servo.number, servo.model)
    middle, reach = 0.5 * (servo.soft_low + servo.soft_high), 0.5 * WITHIN * (servo.soft_high - servo.soft_low)
    low, high, began = middle - reach, middle + reach, bus.clock.now()
    recipe = ServoJoint(loop=known.loop["loop"], kp=known.loop["kp"])
    done, kind = Campaign(servo.joint, (), 0.0, asked=(), pooled=True), "steps"
    for number in range(1, most + 1):
        given = Input(goals_of(kind, low, high, rng), TS, kind)
        step(f"experiment {number} of at most {most}: {kind}, {len(given.u) * TS:.0f} s")
        _wait_for_rest(bus, servo.number, known.model)
        recording, _ = play(bus, servo, check_goals(given, servo), TS, share)
        log = log_of(recording, servo, known, kind)
        keep(number, log, recording)
        done = replace(done, rig_seconds=bus.clock.now() - began)
        if recording.interrupted or (recording.reason and log.N * TS < LEAST):
            reason = f"experiment {number} ended early: {recording.reason}"
            return replace(done, stopped=reason, interrupted=recording.interrupted)
        step(f"experiment {number}: identifying")
        logs.append(log)
        data = IOData.merge(*(each.io() for each in logs))
        fit = fit_joint(data, recipe.model_of(data), starts=recipe.least_starts, seed=seed).fit
        values = joint_values(fit, data=data)
        this = Round(kind, log, values, fit.fit_percent(data))
        done = replace(done, rounds=(*done.rounds, this), asked=_asked(values))
        if not done.open:
            return done
        if number == most:
            break
        if done.rig_seconds + SECONDS > budget:
            return replace(done, stopped=f"the rig time of {budget:g} s is spent")
        step(f"experiment {number + 1}: designing")
        # What the model lacks shows as little in more of the same: a kind that was not played comes first.
        played = {each.what for each in done.rounds}
        new = [name for name in KINDS if name not in played] or list(KINDS)
        kind = max(new, key=lambda name: _worth(fit, data, goals_of(name, low, high, rng), done.open))
    return replace(done, stopped=f"{most} experiments are spent")


def _wait_for_rest(bus: Bus, number: int, model: Model) -> None:
    """Wait until a load whose torque is off swings no more. Raises InputError after `SWINGS`."""
    end = bus.clock.now() + SWINGS
    while True:
        try:
            rest(bus, number, model)
        except InputError:
            if bus.clock.now() > end:
                raise
            bus.clock.wait_until(bus.clock.now() + 0.5)
        else:
            return


def _asked(values: Iterable[JointValue]) -> tuple[str, ...]:
    """The values that are asked of a servo: those of `ASKED` that it has and that were not given."""
    return tuple(v.name for v in values if v.name in ASKED and not (v.determined and v.low == v.high))


def _worth(fit: Fit, data: IOData, u: np.ndarray, open_values: list[str]) -> tuple[int, float]:
    """How many open values the goals u would determine beside `data`, and how narrowly all of them together."""
    record = IOData(u, np.asarray(fit.model.simulate(fit.theta, u)).ravel(), data.Ts)
    values = values_of_simulated(fit.model, fit.theta, record, data, fit.criteria.mse, complete=True, both=True)
    told = [v for v in values if v.name in open_values and v.low is not None and v.high is not None]
    widths = [(v.high - v.low) / max(abs(v.value), 1e-12) for v in told if v.low is not None and v.high is not None]
    return len(told), -float(sum(widths))

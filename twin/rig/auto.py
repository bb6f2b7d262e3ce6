"""From a rig to values: sweep, identify, design what is not determined yet, and again, until all is."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import versions
from sysid.base.quantities import display_quantity
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.excitations import excitation
from sysid.joint.design import TARGETS, Design, design
from sysid.joint.full import searched_from
from sysid.joint.posterior import fit_joint
from sysid.joint.values import JointValue, displayed_value, joint_values
from sysid.structures import actuated_joint
from twin.log import Log
from twin.rig import wire
from twin.rig.calibration import Calibration
from twin.rig.link import Link
from twin.rig.run import Input, check_input, log_of, play
from twin.rig.wiring import go_to_middle

ASKED = tuple(name for names in TARGETS.values() for name in names)
MOST = 3  # experiments
TS = 0.02  # [s]: a lag and a delay of 70 ms are told apart at this, not at 100 ms (docs/record.md)
# A half period of the first sweep, in crossings at full voltage, and how many: about 22 % of it is rest at an end.
HALF, HALVES = 1.6, 10
SHRINK = 0.25  # of the largest input: a joint with much friction crosses at the lower levels too
SHORTEST, LONGEST = 40.0, 125.0  # [s] of the first sweep; of a designed experiment the shortest, too
BUDGET = 600.0  # [s] of rig time, with the wiring and the zero
PART = 0.8  # of the time that is left, for a designed experiment that is not the last
LEAST = 20.0  # [s] of a record that ended early and is still identified


@dataclass(frozen=True)
class Round:
    """One experiment: what was played, its log, and the joint's values from this record, of its `fit`."""

    what: str
    log: Log
    values: tuple[JointValue, ...]
    fit_percent: float
    fit: Fit | None = None

    @classmethod
    def of(cls, what: str, log: Log, fit: Fit, linearity: float) -> "Round":
        """The round of a fit to its log."""
        data = log.io()
        return cls(what, log, joint_values(fit, data=data, linearity=linearity), fit.fit_percent(data), fit)


@dataclass(frozen=True)
class Campaign:
    """The experiments on a joint, for the values `asked`.

    `pooled`: the values of a round are from its log and all before it. `truth` are the hidden values of an emulated
    rig, as far as it knows them. `stopped` says why it ended before all values were determined, empty if they are;
    `interrupted`: a person stopped it.
    """

    joint: str
    rounds: tuple[Round, ...]
    rig_seconds: float
    stopped: str = ""
    interrupted: bool = False
    truth: Mapping[str, float] | None = None
    asked: tuple[str, ...] = ASKED
    pooled: bool = False

    def values_after(self, k: int) -> dict[str, JointValue]:
        """What is known after k experiments: each asked value from the record that determines it most narrowly, or from
        all of them."""
        known: dict[str, JointValue] = {}
        for done in self.rounds[k - 1 if self.pooled else 0 : k]:
            for value in done.values:
                if value.name in self.asked and _width(value) <= _width(known.get(value.name)):
                    known[value.name] = value
        return known

    @property
    def open(self) -> list[str]:
        """The asked values that no record determines."""
        known = self.values_after(len(self.rounds))
        return [name for name in self.asked if not _determines(known.get(name))]

    def with_truth(self, truth: Mapping[str, float]) -> "Campaign":
        """The same with the hidden values."""
        return replace(self, truth=truth)

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal rig auto`, ready for JSON."""
        last = len(self.rounds)
        return {
            "joint": self.joint,
            "experiments": [
                {
                    "what": done.what,
                    "duration": done.log.N * done.log.Ts,
                    "fit_percent": done.fit_percent,
                    "rig": dict(done.log.meta["rig"]),
                    "values": [vars(displayed_value(v)) for v in self.values_after(k + 1).values()],
                }
                for k, done in enumerate(self.rounds)
            ],
            "values": [vars(displayed_value(v)) for v in self.values_after(last).values()],
            "not_determined": self.open,
            "rig_seconds": self.rig_seconds,
            "stopped": self.stopped or None,
            "truth": self._displayed_truth(),
            "versions": versions(),
        }

    def _displayed_truth(self) -> dict[str, float] | None:
        """The hidden values in the units in which `values` are told."""
        if self.truth is None:
            return None
        units = {name: value.unit for name, value in self.values_after(len(self.rounds)).items()}
        return {
            name: self.truth[name] * display_quantity(name, unit).factor
            for name, unit in units.items()
            if name in self.truth
        }


def first_input(calibration: Calibration, seed: int) -> Input:
    """A sweep between drawn levels whose half periods fit the joint's crossing."""
    if calibration.crossing is None:
        raise InputError(f"the ends of the {calibration.joint} have no angles yet; run qpal rig zero first")
    half = max(round(HALF * calibration.crossing * calibration.supply / calibration.largest, 2), 10 * TS)
    settings = {"amplitude": calibration.largest, "half_period": half, "jitter": 0.5, "shrink": SHRINK}
    N = round(float(np.clip(HALVES * half, SHORTEST, LONGEST)) / TS)
    return Input(excitation("sweep", **settings).generate(N, TS, np.random.default_rng([seed, 43])), TS, "first sweep")


def campaign(
    link: Link,
    calibration: Calibration,
    seed: int = 0,
    most: int = MOST,
    budget: float = BUDGET,
    plain_sweeps: bool = False,
    step: Callable[[str], None] = lambda name: None,
    share: Callable[[float], None] = lambda share: None,
    keep: Callable[[int, Log], object] = lambda number, log: None,
    around: Callable[[int, Input, np.ndarray], AbstractContextManager[object]] = lambda *_: nullcontext(),
) -> Campaign:
    """Experiments on the joint of `calibration`, at most `most`, until every value of `ASKED` is determined.

    `budget` [s] is the rig time of all together: a designed experiment has only those of its parts that fit into it.

    `step` hears the name of each part, `share` the progress of a run, and `keep` gets each log as soon as it is there;
    `around` (number, input, levels) gives the context in which both happen.
    With `plain_sweeps` every experiment is another sweep, to compare with. A fault that leaves less than `LEAST` s, a
    lost port, Ctrl-C end it with what is known until then.
    """
    done = Campaign(calibration.joint, (), link.rig_seconds)
    given = first_input(calibration, seed)
    assert calibration.low_counts is not None
    assert calibration.high_counts is not None
    assert calibration.crossing is not None
    to_middle = 2.0 * calibration.crossing  # [s] from end to end, at the most
    for number in range(1, most + 1):
        step(f"experiment {number} of at most {most}: {given.source}, {len(given.u) * given.Ts:.0f} s")
        go_to_middle(link, calibration, calibration.low_counts, calibration.high_counts, to_middle)
        levels = check_input(given, calibration)
        setup = calibration.setup(link.identity.full, calibration.patience(levels, given.Ts))
        with around(number, given, levels):
            recording = play(link, setup, levels, given.Ts, share)
            log = log_of(recording, calibration, link, given.source)
            keep(number, log)
        done = replace(done, rig_seconds=link.rig_seconds)
        if recording.interrupted or (recording.reason and recording.duration < LEAST):
            reason = f"experiment {number} ended early: {recording.reason}"
            return replace(done, stopped=reason, interrupted=recording.interrupted)
        step(f"experiment {number}: identifying")
        data = log.io()
        found = fit_joint(data, actuated_joint(play=False, driver_step=calibration.supply / wire.FULL), seed=seed)
        this = Round.of(given.source, log, found.fit, calibration.linearity)
        done = replace(done, rounds=led_by_each_other((*done.rounds, this), calibration.linearity))
        if not done.open:
            return done
        if number == most:
            break
        step(f"experiment {number + 1}: designing")
        left = budget - link.rig_seconds - to_middle
        sweep = replace(first_input(calibration, seed + 1000 * number), source=f"sweep {number + 1}")
        seconds = left * (PART if number + 1 < most else 1.0)
        designed = None if plain_sweeps else _designed(done, data, calibration, seed + number, seconds)
        if not (plain_sweeps or designed):
            step(f"experiment {number + 1}: the joint that was found would not move; a sweep again")
        given = designed or sweep
        if len(given.u) * given.Ts > left:
            return replace(done, stopped=f"the rig time of {budget:g} s is spent")
    return replace(done, stopped=f"{most} experiments are spent")


def _designed(done: Campaign, data: IOData, calibration: Calibration, seed: int, seconds: float) -> Input | None:
    """The next experiment of at most `seconds` for what is open, on the joint of the last record `data`; None if that
    is no joint which the input moves, as the joint on the rig is.
    """
    targets, fit = [name for name, values in TARGETS.items() if set(values) & set(done.open)], done.rounds[-1].fit
    assert fit is not None
    try:
        plan = design(fit, data, targets, calibration.largest, seed=seed, Ts=TS, to_stops=True)
    except InputError:
        return None
    return shortened(plan, seconds, calibration.largest)


def led_by_each_other(rounds: tuple[Round, ...], linearity: float) -> tuple[Round, ...]:
    """The rounds, each of the likeliest joint to which its own search or the joint of another record leads; the last
    round first."""
    new = list(rounds)
    for k in reversed(range(len(new))):
        own, *others = (each.fit for each in (new[k], *new[:k], *new[k + 1 :]) if each.fit is not None)
        fit = searched_from(own, others, new[k].log.io())
        new[k] = new[k] if fit is own else Round.of(new[k].what, new[k].log, fit, linearity)
    return tuple(new)


def shortened(plan: Design, seconds: float, largest: float) -> Input:
    """The parts of a design that fit into `seconds`: one of each purpose, short ones first, then further ones; all of
    them again where that takes less than `SHORTEST`, since a few seconds tell no joint.

    Each part brings the joint to where it begins, and ends in a rest, so that parts can be left out and repeated.
    """
    names = [phase.name for phase in plan.phases]
    places = [names[:k].count(name) for k, name in enumerate(names)]
    lengths = [phase.stop - phase.start for phase in plan.phases]
    chosen: list[int] = []
    for k in sorted(range(len(names)), key=lambda k: (places[k], lengths[k])):
        if not chosen or plan.Ts * (lengths[k] + sum(lengths[i] for i in chosen)) <= seconds:
            chosen.append(k)
    u = np.concatenate([plan.u[plan.phases[k].start : plan.phases[k].stop] for k in sorted(chosen)])
    u = np.tile(u, max(int(min(np.ceil(SHORTEST / (plan.Ts * len(u))), seconds / (plan.Ts * len(u)))), 1))
    what = ", ".join(dict.fromkeys(names[k] for k in sorted(chosen)))
    return Input(np.clip(u, -largest, largest), plan.Ts, f"for {what}")


def _determines(value: JointValue | None) -> bool:
    return _width(value) < np.inf


def _width(value: JointValue | None) -> float:
    """Width of the interval of a value, infinite where it has none."""
    if value is None or not value.determined or value.low is None or value.high is None:
        return np.inf
    return value.high - value.low

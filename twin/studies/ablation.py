"""Causes of the losses: the fit that an actuated joint loses without each of its parts, and the fit that the paper's
structure gains without each of the twin's imperfections."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

import sysid
from sysid.base.errors import InputError
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Motor, Play, Quantiser, Travel, TravelMap
from sysid.data.preprocess import quick_start
from sysid.data.record import IOData
from sysid.estimation.joint_parts import sub
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.workflow.setting import Setting
from twin.experiment import Experiment, run_all
from twin.imperfections import IMPERFECTIONS
from twin.log import Log
from twin.studies.beyond import JointTrials, Trial, ceiling

STEPS = 4  # what `run` announces
SHARED = tuple(name for name in IMPERFECTIONS if name != "contact")  # a bench leg hangs in the air
ALL_BUT_STOPS = tuple(name for name in SHARED if name != "end_stops")
BARE = "all but end stops"  # imperfections that are off if only the end stops remain
LEFT = 90.0  # [%] below this ceiling the record does not show the joint
LEAST = -1e4  # [%] below this fit a free run is unrelated to its joint
DIVERGES = "diverges"
LEAST_LAG = 1e-3  # samples: a lag too short to appear in a record


def _motor(chain: Chain, hold: dict[str, float], **options: Any) -> Chain:
    """The chain with its motor changed; parameters of `hold` that still exist are fixed."""
    return sub(chain, tuple(replace(b, **options) if isinstance(b, Motor) else b for b in chain.blocks), hold)


def _straight_linkage(chain: Chain) -> Chain:
    return sub(chain, tuple(TravelMap(2, role=b.role) if isinstance(b, Travel) else b for b in chain.blocks))


def _drop(chain: Chain, *kinds: type[Block]) -> Chain:
    return sub(chain, tuple(b for b in chain.blocks if not isinstance(b, kinds)))


# Each part and the chain without it; the same chain if the joint has no such part.
PARTS: dict[str, Callable[[Chain], Chain]] = {
    "end stops": lambda chain: _motor(chain, {}, stops=False, jams=False),
    "dry friction": lambda chain: _motor(chain, dict.fromkeys(("motor.rise", "motor.fall", "motor.loss"), 0.0)),
    "load over position": lambda chain: _motor(chain, {}, load=0, loss=False),
    "friction that falls with speed": lambda chain: _motor(chain, {}, stribeck=False),
    "screw's loss": lambda chain: _motor(chain, {"motor.load0": 0.0}, loss=False),
    "jam": lambda chain: _motor(chain, {}, jams=False),
    "lag": lambda chain: _motor(chain, {"motor.lag": LEAST_LAG}),
    "delay": lambda chain: _motor(chain, {}, delayed=False),
    "linkage (straight line)": _straight_linkage,
    "play": lambda chain: _drop(chain, Play, CoastingPlay),
    "driver's steps": lambda chain: _drop(chain, Quantiser),
}
ALIKE = "load and direction of friction"  # the part that fixed values cannot remove: equal friction in both directions


@dataclass(frozen=True)
class Row:
    """A part and the fit [%] on the validation half without it, or None with the reason."""

    part: str
    fit: float | None
    ceiling: float | None = None
    reason: str = ""


@dataclass(frozen=True)
class Ablation:
    """One record of one joint.

    `joint_fit` is the fit of the whole actuated joint, `joint` the fit without each part; `paper_fit` is the fit of the
    paper's structure on the whole twin, `paper` the fit on the twin without each imperfection.
    """

    name: str
    record: str
    joint_fit: float
    joint: tuple[Row, ...]
    paper_fit: float
    paper: tuple[Row, ...]

    @property
    def single(self) -> tuple[str, ...]:
        """The imperfections that were left out one at a time."""
        return SHARED

    def points_lost(self, row: Row) -> float:
        """Points of fit that the actuated joint loses without a part."""
        return self.joint_fit - row.fit if row.fit is not None else np.nan

    def points_gained(self, row: Row) -> float:
        """Points of fit that the paper's structure gains without an imperfection; a fit below 0 counts as 0.

        A model worse than the mean is useless, and how much worse it is depends on chance.
        """
        return max(row.fit, 0.0) - max(self.paper_fit, 0.0) if row.fit is not None else np.nan

    @property
    def behind(self) -> float:
        """Points by which the paper's structure is behind the actuated joint; a fit below 0 counts as 0."""
        return self.joint_fit - max(self.paper_fit, 0.0)

    def as_dict(self) -> dict[str, Any]:
        """The same, ready for JSON."""
        return {
            "actuated_joint": {"whole": self.joint_fit, "without": {row.part: row.fit for row in self.joint}},
            "paper_structure": {
                "whole": self.paper_fit,
                "without": {row.part: {"fit": row.fit, "ceiling": row.ceiling} for row in self.paper},
            },
        }


def run(
    study: JointTrials, setting: Setting, announce: Callable[[str], None] = lambda name: None, threads: int = 2
) -> tuple[Ablation, ...]:
    """Both ablations on both records of a joint; `setting` is the paper's."""
    ablations = []
    for trial in study.trials:
        announce(f"{study.joint}: actuated joint with parts left out, {trial.record}")
        joint = tuple(without_parts(trial))
        announce(f"{study.joint}: twin with imperfections left out, {trial.record}")
        paper = tuple(without_imperfections(study.joint, trial, setting, threads))
        ablations.append(
            Ablation(study.joint, trial.record, trial.joint.validation_fit, joint, trial.paper.validation_fit, paper)
        )
    return tuple(ablations)


def without_parts(trial: Trial) -> list[Row]:
    """The actuated joint fitted again without each of its parts, on the record of the trial."""
    e, complete = trial.joint, trial.joint.fit
    assert isinstance(complete, Fit)
    rows = []
    for part, drop in PARTS.items():
        chain = drop(complete.model)
        if chain == complete.model:
            rows.append(Row(part, None, reason="the joint is without it"))
            continue
        fit = sysid.fit(chain, e.estimation, starts=e.setting.starts, seed=e.setting.seed)
        with np.errstate(over="ignore", invalid="ignore"):  # without stops a free run may overflow
            percent = fit.fit_percent(e.validation)
        rows.append(Row(part, percent) if percent > LEAST else Row(part, None, reason=DIVERGES))
    rows.insert(3, Row(ALIKE, _alike(complete, e.estimation).fit_percent(e.validation)))
    return rows


def _alike(complete: Fit, data: IOData) -> Fit:
    """The joint without a load and with one dry friction for both directions, found along a line of its values."""
    parameters = {p.name: p.value for p in complete.parameters}
    middle = 0.5 * (parameters["motor.rise"] + parameters["motor.fall"])

    def fit_with(friction: float, starts: int) -> Fit:
        hold = dict.fromkeys(("motor.rise", "motor.fall"), friction)
        return sysid.fit(_motor(complete.model, hold, load=0, loss=False), data, starts=starts)

    best = minimize_scalar(
        lambda friction: fit_with(friction, 1).criteria.loss,
        bounds=(0.0, 2.0 * middle + 1e-3),
        method="bounded",
        options={"maxiter": 12},
    )
    return fit_with(float(best.x), 3)


def without_imperfections(joint: str, trial: Trial, setting: Setting, threads: int = 2) -> list[Row]:
    """The paper's structure fitted to the twin without each imperfection, under the trial's own excitation."""
    cases = {**{name: (name,) for name in SHARED}, BARE: ALL_BUT_STOPS}
    complete = experiment(trial.log)
    logs: dict[str, Log] = {}
    for play in (
        True,
        False,
    ):  # without backlash the model has one joint less, and parallel runs must have equal models
        group = {name: replace(complete, without=w) for name, w in cases.items() if play == ("backlash" not in w)}
        if group:
            logs |= dict(zip(group, run_all(list(group.values()), threads), strict=True))
    return [_paper_row(name, logs[name], setting) for name in cases]


def experiment(log: Log) -> Experiment:
    """The experiment that gave a log, from the log's own header."""
    meta = log.meta
    return Experiment(
        joint=log.joint,
        excitation=meta["excitation"],
        duration=meta["duration"],
        Ts=log.Ts,
        seed=meta["seed"],
        options=meta["options"],
    )


def _paper_row(name: str, log: Log, setting: Setting) -> Row:
    estimation, validation = quick_start(log.io())
    try:
        model = setting.recipe.model()
        objective = sysid.Objective(knots=setting.knots)
        fit = sysid.fit(model, estimation, setting.search, setting.starts, setting.seed, objective=objective)
    except InputError as error:  # without friction or stops a joint may leave any reasonable range
        return Row(name, None, reason=str(error))
    best_percent = ceiling(log, slice(estimation.N + fit.n_init, None))
    if best_percent < LEFT:
        return Row(name, None, best_percent, "the joint leaves the potentiometer's range")
    return Row(name, fit.fit_percent(validation), best_percent)

"""What is said to try next is tried first, within a budget of time: its gain is quoted, and what does not help is left.

A step helps where it leaves clearly less of the same unseen samples: by more than chance explains (the paired test of
the structure search) and by more than counts as nothing. A smaller model helps where it predicts as well and BIC
prefers it (Schwarz 1978, Annals of Statistics 6). Without unseen samples BIC decides alone.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.compiled import CompilationRefusedError, refusing_compilation
from sysid.base.errors import InputError
from sysid.block.ahead import compile_blocks
from sysid.data.record import IOData
from sysid.diagnosis.residuals import CLOSE, poor
from sysid.estimation.result import Fit
from sysid.nlarx.result import NlarxFit
from sysid.selection.table import BLOCKS, SECONDS, larger
from sysid.structures import ActuatedJoint, OutputError, ProcessModel, ServoJoint
from sysid.workflow.changes import AUTO, changed_setting, detrend_after
from sysid.workflow.next_step import AS_WELL, against_the_record
from sysid.workflow.results import Evaluation, Identification
from sysid.workflow.setting import Setting
from sysid.workflow.steps import Gain, NextStep

LEAST = 2.0  # [s] of a budget that is not given: a linear model takes a tenth of it, one with maps most of it
_JOINTS = (ActuatedJoint.name, ServoJoint.name)
_WITH_PARTS = 5.0  # [s] of a joint that grows its parts, on 1000 samples
_LONGER = "it needs more time than this fit took"
REACH = 1.5  # times what the best step leaves, within which another one is said too, as a structure search goes on
Attempt = Callable[[Setting, float | None, str], Evaluation]  # of a setting, a split and what is removed


@dataclass(frozen=True)
class _Trial:
    """A step with its evaluation; `left` [points of fit] is what it leaves, counted in those that the result leaves."""

    step: NextStep
    evaluation: Evaluation
    left: float

    def like(self, best: "_Trial") -> bool:
        """Whether it leaves hardly more than the best, and no more than chance explains where both saw the same."""
        near = self.left <= best.left + CLOSE
        if not near or self is best or "split" in {**self.step.change, **best.step.change}:
            return near
        if not self.evaluation.unseen or _simpler(best.evaluation, self.evaluation):
            return _by_bic(best.evaluation, self.evaluation)
        parts = [(trial.evaluation, trial.evaluation.validation) for trial in (self, best)]
        return not larger(*_stretches(parts, None))


def tried(
    result: Identification, steps: Sequence[NextStep], attempt: Attempt, seconds: float | None = None
) -> tuple[NextStep, ...]:
    """At most two of the steps: those that help, the best first; else those that have evidence and were not tried.

    `seconds` is the budget for all of them; None for that of `_usual`, in which nothing is compiled but, before it
    begins, the loop of a process. 0 tries nothing.
    """
    budget = _usual(result, steps) if seconds is None else seconds
    if budget:
        _compile_process(steps)
    early = _early(result, steps, budget)
    end, helpful, missed = time.monotonic() + budget, list[_Trial](), list[NextStep]()
    for step in sorted(steps, key=lambda step: _turn(step, early)):
        remaining = end - time.monotonic()
        outcome = _try(result, step, attempt, remaining, may_compile=seconds is not None) if budget else step
        if isinstance(outcome, _Trial):
            helpful.append(outcome)
        elif outcome is not None:
            missed.append(outcome)
    order = [step.command for step in steps]
    untried = sorted((step for step in missed if not step.guess), key=lambda step: order.index(step.command))
    if not helpful:
        return tuple(untried[:2])
    # Of steps whose gains are alike the smallest model is said, and of those the first; one that has evidence is alike
    # also where a guess is better by more than chance, but by nothing that counts.
    first = min(helpful, key=lambda t: t.left)
    alike = [
        t for t in helpful if t.like(first) or (first.step.guess and not t.step.guess and t.left <= first.left + CLOSE)
    ]
    best = min(alike, key=lambda t: (t.evaluation.fit.criteria.d, order.index(t.step.command)))
    # The motor that the record is of has to be compiled, or takes longer: it is said before a second best.
    tests, motor = best.evaluation.tests, [s for s in untried if s.change.get("structure") == ActuatedJoint.name]
    if motor and tests is not None and not tests.independent:
        return best.step, motor[0]
    others = [t for t in helpful if t.step.why != best.step.why and t.left <= REACH * best.left]
    if others:
        return best.step, min(others, key=lambda t: t.left).step
    return (best.step, *(untried[:1] if poor(best.evaluation.judged_fit, tests) else ()))


def _usual(result: Identification, steps: Sequence[NextStep]) -> float:
    """Seconds for all trials: as long as the fit took, at least `LEAST`, and twice what a step takes to which the
    record points, unless it takes longer than a fit: it comes first, and is not only said.
    """
    took = result.evaluation.fit.seconds
    due = [_due(result, step) for step in steps]
    return max(LEAST, took, *(2.0 * each for each in due if each <= max(took, _WITH_PARTS)))


def _due(result: Identification, step: NextStep) -> float:
    """How long [s] a step takes to which the record points, in the same structure or as a joint; inf for others."""
    if step.guess or not step.change or step.change.get("structure") not in (None, *_JOINTS):
        return np.inf
    return _expected(result, changed_setting(result, **{k: v for k, v in step.change.items() if k != "split"}))


def _early(result: Identification, steps: Sequence[NextStep], budget: float) -> list[NextStep]:
    """The steps that have evidence and together leave half of the budget to what costs little."""
    early, due = list[NextStep](), 0.0
    for step in sorted(steps, key=lambda step: _due(result, step)):
        due += _due(result, step)
        if due > 0.5 * budget:
            break
        early.append(step)
    return early


def _turn(step: NextStep, early: Sequence[NextStep]) -> tuple[int, bool]:
    """What has evidence and leaves half of the budget comes first, then a linear model, which costs little; then other
    evidence, and other guesses.
    """
    structure = step.change.get("structure")
    if structure in (OutputError.name, ProcessModel.name):
        return 1, False
    if step in early:
        return 0, False
    return 2 + step.guess, structure is not None


def _compile_process(steps: Sequence[NextStep]) -> None:
    """The one loop of all processes, some seconds once on a machine: whether they are tried must not depend on that."""
    if any(step.change.get("structure") == ProcessModel.name for step in steps):
        compile_blocks(ProcessModel().model().blocks)


def _try(
    result: Identification, step: NextStep, attempt: Attempt, seconds: float, may_compile: bool
) -> _Trial | NextStep | None:
    """The trial of a step that helps; the step where it was not tried, with the reason; None of one without a gain."""
    change = dict(step.change)
    if not change:
        return step
    if change.get("structure") == AUTO:
        return replace(step, missed=f"it takes up to {SECONDS:g} s")
    split = change.pop("split", None) or result.split
    setting = changed_setting(result, **change)
    if seconds <= 0 or _expected(result, setting) > REACH * seconds:
        return replace(step, missed=_LONGER)
    setting = replace(setting, seconds=seconds)
    refused: list[str] = []
    try:
        if may_compile:
            e = attempt(setting, None if split == 0.5 else split, detrend_after(result, setting.recipe.name))
        else:
            with refusing_compilation() as refused:
                e = attempt(setting, None if split == 0.5 else split, detrend_after(result, setting.recipe.name))
    except CompilationRefusedError:
        pass
    except InputError:  # the command would be refused too
        return None if not refused else replace(step, missed="it has to be compiled first")
    if refused:
        return replace(step, missed="it has to be compiled first")
    is_cut = e.fit.seconds >= setting.seconds or (e.joint_fit is not None and bool(e.joint_fit.stopped))
    gain = gain_of(result, step, e)
    if gain is None:
        return replace(step, missed=_LONGER) if is_cut else None
    base = 100.0 - result.evaluation.judged_fit
    left = (
        base * (100.0 - gain.fit) / max(100.0 - gain.instead, 1e-9) if np.isfinite(gain.instead) else 100.0 - gain.fit
    )
    why = step.why.replace(AS_WELL, "predicts better") if gain.fit >= gain.instead + CLOSE else step.why
    gain = replace(gain, after=e.fit.seconds if is_cut else None)
    return _Trial(replace(step, why=why, gain=gain), e, left)


def _expected(result: Identification, setting: Setting) -> float:
    """How long [s] a fit of the same structure takes, by that of the result; of another one that is hardly known."""
    s = result.evaluation.setting
    if setting.recipe.name == s.recipe.name:
        return result.evaluation.fit.seconds * setting.starts / s.starts
    return _WITH_PARTS if setting.recipe.with_parts else 0.0


def gain_of(result: Identification, step: NextStep, other: Evaluation) -> Gain | None:
    """What a step brings on the data that its command judges it by; None where it does not help."""
    e = result.evaluation
    if (other.joint is not None and not other.joint.joint) or against_the_record(other):
        return None
    if e.growing is not None and other.growing is None:  # the fit of a free run beside that of a prediction
        return None
    data, of = e.validation, ""
    if (split := step.change.get("split")) is not None:
        data, of = (
            replace(result.plan, split=split).parts(result.record.data)[1],
            f"on the last {100 * (1 - split):.0f} %,",
        )
    ahead = None if other.growing is None else other.growing.horizon
    of = of if other.growing is None else f"predicted {other.growing.ahead},"
    instead = e.judged_fit
    if ahead is not None and not isinstance(e.fit, Fit):
        return None
    if isinstance(e.fit, Fit) and ahead is not None:
        instead = e.fit.prediction_percent(data, horizon=ahead)
    elif data is not e.validation:
        instead = e.fit.fit_percent(data)
    gain = Gain(other.judged_fit, instead, of, fewer=e.fit.criteria.d - other.fit.criteria.d)
    return gain if _helps(e, other, gain, data, ahead) else None


def _helps(e: Evaluation, other: Evaluation, gain: Gain, data: IOData, ahead: int | None) -> bool:
    if not gain.fit > 0.0:  # a free run that is worse than the mean of the data is no model
        return False
    is_better = not gain.fit < gain.instead + CLOSE  # also where the first run diverges
    if _simpler(e, other) and not poor(e.judged_fit, e.tests):
        return gain.fit > gain.instead - CLOSE
    if not e.unseen:
        return is_better and _by_bic(e, other)
    if not is_better:
        return False
    before, after = _stretches([(e, data), (other, other.validation)], ahead)
    return len(before) > 1 and (not np.isfinite(before).all() or larger(before, after))


def _by_bic(e: Evaluation, other: Evaluation) -> bool:
    """Whether BIC prefers the other one, where both are of the same samples and kind of fit."""
    a, b = e.fit.criteria, other.fit.criteria
    return a.N == b.N and e.fit.predicts == other.fit.predicts and b.bic < a.bic


def _simpler(e: Evaluation, other: Evaluation) -> bool:
    """Whether the other one is smaller, and BIC prefers it; errors of one step and of a free run have no common BIC, so
    of those the other one has to be as good on unseen samples, in free run."""
    if other.fit.criteria.d >= e.fit.criteria.d:
        return False
    if e.fit.predicts != other.fit.predicts:
        return e.unseen and e.growing is None and other.validation_fit >= e.validation_fit
    return _by_bic(e, other)


def _stretches(parts: Sequence[tuple[Evaluation, IOData]], ahead: int | None) -> np.ndarray:
    """Mean squared errors (2, n) of two models on the same stretches, without those where the second has none."""
    stretches = [np.array_split(_errors(e.fit, data, ahead), BLOCKS) for e, data in parts]
    means = np.array([[s.mean() if len(s) else np.nan for s in each] for each in stretches])
    return means[:, np.isfinite(means[1]) & ~np.isnan(means[0])]


def _errors(fit: Fit | NlarxFit, data: IOData, ahead: int | None) -> np.ndarray:
    """Squared errors (n,) of the samples that are measured, in the variance of each output."""
    run = fit.simulate(data) if ahead is None else fit.predict(data, horizon=ahead)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (data.y - np.reshape(run, data.y.shape)) ** 2 / np.var(data.y, axis=0)
        return squares[data.observed.all(axis=1)].mean(axis=1)

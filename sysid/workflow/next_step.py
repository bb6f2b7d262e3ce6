"""The next step after a poor fit: one sentence and one command, by rules on the fit and on the record."""

import shlex
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.limits import MORE_STARTS
from sysid.base.poles import Motion
from sysid.data.wraps import DEGREES
from sysid.diagnosis.relation import without_effect
from sysid.diagnosis.residuals import CLOSE, POOR, poor
from sysid.diagnosis.signals import AT_STOPS, NO_VALUE, WRAPS
from sysid.model.recipes import Recipe
from sysid.structures import (
    ActuatedJoint,
    Armax,
    HammersteinWiener,
    NonlinearArx,
    NonlinearStateSpace,
    OutputError,
    ProcessModel,
    ServoJoint,
)
from sysid.workflow.advice_after_fit import holds, in_loop, nonlinear
from sysid.workflow.changes import STARTS, command
from sysid.workflow.evaluation import OVERFITTED, has_ample_samples
from sysid.workflow.remarks import extrapolated_signals, gain_remarks, share_outside
from sysid.workflow.results import Evaluation, Identification
from sysid.workflow.room import with_room
from sysid.workflow.servo import is_of_servo
from sysid.workflow.steps import NextStep
from sysid.workflow.what_is_left import lasts, unexplained, zeros_differ

MUCH, MOST = 0.2, 0.5  # of the validation part
AS_WELL = "does as well"
INCOMPLETE = "the residuals are coloured, so the model is incomplete"
_INTEGRATES = "the plant integrates over all of this record"
SPLITS = (0.6, 0.7, 0.8)

_Rule = Callable[[Identification], "NextStep | Iterable[NextStep] | None"]


def next_step(result: Identification) -> NextStep | None:
    """The first of `proposals` that has evidence in the record; None if the fit is good."""
    return next((step for step in proposals(result) if not step.guess), None)


def proposals(result: Identification) -> list[NextStep]:
    """What may be tried next, first what is most likely to help; none if the fit is good or the residuals are noise,
    and the record is what the model says.

    A fit is poor in validation by `sysid.diagnosis.residuals.poor`. A better fit has a next step if its search did not
    converge, if its residuals are coloured and leave more than counts as nothing, or if a part of it is not determined;
    but an actuated joint's residuals are rarely white, and no other structure fits better.
    """
    e = result.evaluation
    is_bad = poor(e.judged_fit, e.tests) or against_the_record(e)
    if (first := _logging_fault(result, is_bad)) is not None:
        return [first]
    if is_bad and without_effect(result.advice) is not None:  # no model finds what is not there
        return []
    if not e.fit.stop.converged or (e.joint_fit is not None and e.joint_fit.stopped):
        longer_search = _more_time(result)
        if longer_search is not None:  # what else may be wrong is seen after the whole search
            return [longer_search]
    if (longer_search := _budget(result) if is_bad else None) is not None:
        return [longer_search]
    found = {step.command: step for rule in _rules(e, is_bad) for step in _steps(rule(result))}
    return with_room(result, found.values())


def _rules(e: Evaluation, is_bad: bool) -> tuple[_Rule, ...]:
    if e.joint is not None and not e.joint.joint:
        return (_no_joint,)
    if e.outputs:
        if is_bad:
            return (_nonlinear, _uncovered_validation, _coverage, _no_maps, _offset, _more_starts, _general)
        return (_nonlinear, _no_maps, _offset, _general, _more_starts) if unexplained(e) else ()
    if is_bad:  # what the structure cannot describe comes before what it has not seen
        rules = (_ends, _servo, _motor, _loop, _nonlinear, _uncovered_validation, _delay, _focus, _coverage, _offset)
        return (*rules, _process, _integrator, _no_maps, _sizes, _more_starts, _search_structures, _other_kind)
    if not e.fit.stop.converged:
        return (_process, _integrator, _servo, _motor, _offset, _more_starts, _no_maps, _undetermined)
    is_coloured = e.tests is not None and not e.tests.white and e.judged_fit < 100.0 - CLOSE
    if is_coloured and not isinstance(e.setting.recipe, ActuatedJoint):
        physics = (_ends, _servo, _motor)
        smaller = (*physics, _nonlinear, _delay, _undetermined, _offset, _process, _integrator, _no_maps, _sizes)
        depends = e.tests is not None and not e.tests.independent
        # A search costs minutes: it is for an error that noise or a constant does not explain.
        return (*smaller, _search_structures) if depends or unexplained(e) else smaller
    return (_integrator, _undetermined) if isinstance(e.setting.recipe, ProcessModel) else (_undetermined,)


def _steps(found: NextStep | Iterable[NextStep] | None) -> Iterable[NextStep]:
    return () if found is None else (found,) if isinstance(found, NextStep) else found


def _step(why: str, result: Identification, guess: bool = False, **change: Any) -> NextStep:
    """The step that a change of the command is, which can be tried."""
    return NextStep(why, command(result, **change), change, guess)


def against_the_record(e: Evaluation) -> bool:
    """Whether the model's gain has the other sign than the record's."""
    return bool(gain_remarks(e.estimation, e.validation, e.validation_output, None if e.step is None else e.step.y))


def _logging_fault(result: Identification, is_bad: bool) -> NextStep | None:
    """A record with jumps as it was logged: no model describes that. What stands for none is in any fit."""
    for a in result.advice:
        advice_text, _, fix = a.action.rpartition(": ")
        if a.topic == WRAPS and is_bad:
            return NextStep(f"{a.sentence}: {advice_text}", fix)
        if a.topic == "outliers" and NO_VALUE in a.sentence:
            return NextStep(f"{a.sentence}: {a.action.partition(', which')[0]}", command(result))
    return None


def _more_time(result: Identification) -> NextStep | None:
    """A search with a budget of its own that ended before it was done."""
    seconds = result.evaluation.setting.seconds
    if result.selection is not None or not seconds < np.inf:
        return None
    return NextStep("the search ran out of time", f"{command(result)} --seconds {2.0 * seconds:g}")


def _budget(result: Identification) -> NextStep | None:
    """A search for structures whose time ended before it had tried them all: it goes on from its journal."""
    selection = result.selection
    if selection is None or not selection.cut:
        return None
    return NextStep(selection.cut, command(result, seconds=3.0 * selection.budget))


def _no_joint(result: Identification) -> NextStep | None:
    """The record is not that of a joint: a search over all structures, or, after one, a model without physics.

    A record that does not show whether it is a joint's, or half of which hardly moves, is to be followed by another.
    """
    e = result.evaluation
    is_uncovered = share_outside(e.estimation, e.validation) > MOST
    if is_uncovered or (e.joint is not None and e.joint.undetermined):
        record = result.record
        first = str(record.files[0] if record.files else record.path)  # an experiment follows from one record
        words = ["qpal", "design", first, *record.options]
        return NextStep("this record is too short to show a joint", shlex.join(words))
    reason = "the record is not that of an actuated joint"
    if result.selection is None:
        return _step(f"{reason}{_left_out(result)}", result, structure="auto")
    if not poor(e.judged_fit, e.tests):  # it predicts better than what the search passed over
        return None
    reason = f"{reason}, which the search chose"
    return _step(reason, result, structure=HammersteinWiener.name)


def _ends(result: Identification) -> NextStep | None:
    """The record rests at its ends and the model has no end stops; a structure search has tried a model with them."""
    recipe = result.evaluation.setting.recipe
    rests = next((a.sentence for a in result.advice if a.topic == "rest" and AT_STOPS in a.sentence), "")
    if not rests or result.selection is not None or isinstance(recipe, ActuatedJoint):
        return None
    if result.plan.preparation.filter[0] is not None:  # its volts and angles would not count from zero
        return None
    reason = f"{rests.partition(':')[0]}, and this model has no end stops"
    return _step(reason, result, structure=ActuatedJoint.name)


def _servo(result: Identification) -> NextStep | None:
    """The input is a goal by its name, and the model has no loop; a structure search has tried one that has."""
    recipe = result.evaluation.setting.recipe
    if result.selection is not None or recipe.with_parts or not is_of_servo(result.record.signals):
        return None
    if result.plan.preparation.filter[0] is not None:  # its goals and angles would not count from zero
        return None
    return _step("the input is a goal, and this model has no servo's loop", result, structure=ServoJoint.name)


def _loop(result: Identification) -> NextStep | None:
    """A controller makes the input, or the plant integrates or is not stable: a model that predicts; not of a motor."""
    e = result.evaluation
    if e.fit.predicts or isinstance(e.setting.recipe, ActuatedJoint):
        return None
    if in_loop(result.advice):
        reason = "the input seems to come from a controller of the output"
    elif e.motion == Motion.STABLE or _motor(result) is not None:
        return None
    else:
        reason = "the plant seems to integrate, or is not stable"
    return _step(f"{reason}, where a free run says little", result, structure=Armax.name)


def _motor(result: Identification) -> NextStep | None:
    """A voltage moves an angle or a length, and goes on as long as it acts: a motor, with end stops or without."""
    e = result.evaluation
    moves = e.estimation.u_unit == "V" and e.estimation.y_unit in ("rad", "m", *DEGREES) and lasts(e)
    is_raw = result.plan.preparation.filter[0] is None  # else its volts and angles would not count from zero
    if e.outputs or e.physical or result.selection is not None or in_loop(result.advice) or not (moves and is_raw):
        return None
    reason = "the output goes on while a voltage acts, as that of a motor"
    return _step(reason, result, structure=ActuatedJoint.name)


def _delay(result: Identification) -> NextStep | None:
    """Orders that cannot represent the delay of the record; a record of a closed loop does not show it."""
    recipe = result.evaluation.setting.recipe
    delays = [a.value for a in result.advice if a.topic == "delay" and np.isfinite(a.value)]
    if not {"nb", "nk"} <= set(recipe.orders) or result.selection is not None or not delays or in_loop(result.advice):
        return None
    delay, nk = int(delays[0]), recipe.orders["nk"]
    if holds(recipe, delay):
        return None
    reason = f"the output responds after {delay} sample(s), but the model's delay is {nk}"
    return _step(reason, result, nk=delay)


def _focus(result: Identification) -> NextStep | None:
    """A nonlinear ARX model fitted for one-step-ahead prediction and poor in free run."""
    recipe = result.evaluation.setting.recipe
    if not isinstance(recipe, NonlinearArx) or recipe.focus != "prediction":
        return None
    reason = "the model was fitted for one-step-ahead prediction and its free-run fit is poor"
    return _step(reason, result, focus="simulation")


def _uncovered_validation(result: Identification) -> NextStep | None:
    """Validation data of which a large share is outside the range of the estimation data."""
    e = result.evaluation
    return _coverage(result) if share_outside(e.estimation, e.validation) > MUCH else None


def _coverage(result: Identification) -> NextStep | None:
    """Validation data outside the range of the estimation data, and a split that corrects this."""
    e = result.evaluation
    if result.plan.validation is not None or not extrapolated_signals(e.estimation, e.validation):
        return None
    limit = share_outside(e.estimation, e.validation) / 4
    for split in SPLITS:
        if split > result.split and _share_outside_split(result, split) <= limit:
            reason = (
                "the validation data leave the range of the estimation data; a longer estimation part covers more of it"
            )
            return _step(reason, result, split=split)
    return None


def _share_outside_split(result: Identification, split: float) -> float:
    try:
        return share_outside(*replace(result.plan, split=split).parts(result.record.data))
    except InputError:  # too short for this split
        return np.inf


def _nonlinear(result: Identification) -> NextStep | None:
    """A linear model of a nonlinear record."""
    linear = isinstance(result.evaluation.setting.recipe, OutputError)
    if not linear or result.selection is not None or not nonlinear(result.advice):
        return None
    reason = "the record is nonlinear, and this model is linear"
    return _step(reason, result, structure=HammersteinWiener.name)


def _more_starts(result: Identification) -> NextStep | None:
    """A search that stopped early or had few starts."""
    stop, starts = result.evaluation.fit.stop, result.evaluation.setting.starts
    if result.evaluation.setting.held.start is not None:
        reason = "the search began at one saved fit only"
        return _step(reason, result, starts=STARTS, anew=True)
    wanted = STARTS if stop.converged else MORE_STARTS
    if starts >= wanted:
        return None
    reason = "the search had few starting points" if stop.converged else "the search did not converge"
    return _step(f"{reason} ({starts} start{'s' * (starts != 1)})", result, starts=wanted)


def _general(result: Identification) -> NextStep | None:
    """The most general structure of several inputs and outputs."""
    if isinstance(result.evaluation.setting.recipe, NonlinearStateSpace):
        return None
    return _step("this structure does not explain the record", result, structure=NonlinearStateSpace.name)


def _search_structures(result: Identification) -> NextStep | None:
    """Another structure or size, by a search that validates candidates on data not used in their fit."""
    if result.selection is not None:
        return None
    return _step(f"{_lack(result.evaluation)}{_left_out(result)}", result, structure="auto", starts=2)


def _left_out(result: Identification) -> str:
    """Which known values a search does not take."""
    recipe = (result.asked or result.evaluation.setting).recipe
    known = [name for name in recipe.of_kind("number") if getattr(recipe, name) != getattr(type(recipe)(), name)]
    names = " and ".join(f"--{name.replace('_', '-')}" for name in known)
    return f" (a search does not take {names})" if names else ""


def _lack(e: Evaluation) -> str:
    """What is wrong with a model of which no more is known."""
    if e.fall > OVERFITTED:
        ample = has_ample_samples(e.fit)
        return "the two parts of the record differ" if ample else "the model is too large for this record"
    return INCOMPLETE if e.judged_fit >= POOR else "this structure does not explain the record"


def _offset(result: Identification) -> NextStep | None:
    """A model whose output is zero where its input is; means that were removed are those of no operating point. Of
    several logs, one whose zero is the same in all of them."""
    recipe = result.evaluation.setting.recipe
    offset, several = getattr(recipe, "offset", "each"), len(result.record.data.experiments) > 1
    if offset == "each" or result.selection is not None or not (several or offset == "none"):
        return None
    if several:
        # A search that did not converge has a next step anyway, and a zero of each log costs less than more starts.
        is_guess = result.evaluation.fit.stop.converged and not zeros_differ(result.evaluation)
        return _step("the zero of the output may differ between the logs", result, guess=is_guess, offset="each")
    return _step("the zero of the output is held", result, guess=True, offset="free")


def _integrator(result: Identification) -> Iterable[NextStep]:
    """A process with an integrator, where the plant settles, if at all, after the record: nothing shows its end."""
    e = result.evaluation
    recipe = e.setting.recipe
    if result.selection is not None or e.outputs or recipe.with_parts or not lasts(e):
        return
    process, other = (recipe, {}) if isinstance(recipe, ProcessModel) else (ProcessModel(), {"structure": "process"})
    for each in process.integrating():
        yield _step(_INTEGRATES, result, guess=True, **other, kind=each.kind)


def _no_maps(result: Identification) -> NextStep | None:
    """The linear block of a model with maps, or one of each input and output in place of a state space."""
    recipe = result.evaluation.setting.recipe
    is_block = bool(recipe.of_kind("map")) and set(recipe.orders) == {"nb", "nf", "nk"}
    if result.selection is not None or not (is_block or isinstance(recipe, NonlinearStateSpace)):
        return None
    orders = recipe.orders if is_block else {}
    return _step(f"a linear model {AS_WELL}", result, guess=True, structure=OutputError.name, **orders)


def _process(result: Identification) -> Iterable[NextStep]:
    """A plant that is slow beside its samples, and has a delay, in place of a model of samples: with one time constant
    and with two, and several logs with a zero each too.
    """
    e = result.evaluation
    is_single = e.estimation.u.shape[1] == e.estimation.y.shape[1] == 1
    if result.selection is not None or not is_single or not {"nb", "nk"} <= set(e.setting.recipe.orders):
        return
    zeros: list[dict[str, Any]] = [{}, {"offset": "each"}] if len(result.record.data.experiments) > 1 else [{}]
    for kind, zero in product(("P1D", "P2D"), zeros):
        yield _step(f"a process {AS_WELL}", result, guess=True, structure=ProcessModel.name, kind=kind, **zero)


def _sizes(result: Identification) -> Iterable[NextStep]:
    """The neighbours of the settings, the largest first; of a model that seems too large the smaller ones first."""
    e = result.evaluation
    recipe = e.setting.recipe
    if result.selection is not None or isinstance(recipe, ActuatedJoint) or recipe.with_parts:
        return
    too_large = e.fall > OVERFITTED and not has_ample_samples(e.fit)
    too_large |= e.growing is not None and bool(unexplained(e))
    for neighbour in sorted(recipe.neighbours(), key=_size, reverse=not too_large):
        if too_large or _size(neighbour) >= _size(recipe):
            better = "another size of this model does better"  # said where the trial has shown it
            yield _step(better, result, guess=True, **_difference(recipe, neighbour))


def _undetermined(result: Identification) -> Iterable[NextStep]:
    """What the model is without the values whose interval holds the least that they can be."""
    e = result.evaluation
    recipe, values = e.setting.recipe, {value.name: value for value in e.values}
    if isinstance(recipe, ProcessModel) and lasts(e):  # an integrator, which no smaller process describes
        return
    for name, (least, without) in recipe.parts(e.estimation.Ts).items():
        value = values.get(name)
        if value is not None and (value.low is None or value.high is None or value.low <= least <= value.high):
            for smaller in without:
                yield _step(f"{name} is not determined", result, **_difference(recipe, smaller))


def _size(recipe: Recipe) -> int:
    """That of its orders but a delay, or the number of its parameters."""
    return sum(value for name, value in recipe.orders.items() if name != "nk") or len(recipe.model().names)


def _difference(recipe: Recipe, other: Recipe) -> dict[str, Any]:
    """The settings in which another recipe of the same structure differs."""
    names = (*recipe.orders, *recipe.as_dict())
    return {name: getattr(other, name) for name in names if getattr(other, name) != getattr(recipe, name)}


def _other_kind(result: Identification) -> NextStep | None:
    """A search found no block model; a nonlinear ARX model does not assume blocks, unless the search has tried it."""
    if result.selection is None or any(r.candidate.name == NonlinearArx.name for r in result.selection.rows):
        return None
    return _step("no block structure explains the record", result, structure=NonlinearArx.name)

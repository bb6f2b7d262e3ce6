"""The next step after a poor fit: one sentence and one command, by rules on the fit and on the record."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.limits import MORE_STARTS
from sysid.base.poles import Motion
from sysid.data.record import IOData
from sysid.diagnosis.finding import Advice
from sysid.diagnosis.residuals import POOR, poor
from sysid.diagnosis.signals import NO_VALUE, WRAPS
from sysid.model.recipes import Recipe
from sysid.selection.table import SECONDS
from sysid.structures import (
    ActuatedJoint,
    Armax,
    Arx,
    BoxJenkins,
    Hammerstein,
    HammersteinWiener,
    NonlinearArx,
    NonlinearStateSpace,
    OutputError,
    Wiener,
)
from sysid.workflow.evaluation import OVERFITTED, has_ample_samples
from sysid.workflow.plan import Plan
from sysid.workflow.remarks import JOINT_RECORD, extrapolated_signals, gain_remarks
from sysid.workflow.results import Evaluation, Identification, NextStep

STARTS = 5  # with fewer, another start may find more; from the second on it rarely does
MUCH, MOST = 0.2, 0.5  # of the validation part
SPLITS = (0.6, 0.7, 0.8)
_CLASSES = {
    OutputError.name: 0,
    Armax.name: 1,
    Arx.name: 0,
    BoxJenkins.name: 1,
    Hammerstein.name: 1,
    Wiener.name: 1,
    HammersteinWiener.name: 2,
}
_RICHER = 3  # every other structure


def next_step(result: Identification) -> NextStep | None:
    """The next step; None if the fit is good or the residuals are noise, and the record is what the model says.

    A fit is poor in validation by `sysid.diagnosis.residuals.poor`. A better fit has a next step if its search did not
    converge or its residuals are coloured, except for an actuated joint: its residuals are rarely white, and no other
    structure fits better.
    """
    e = result.evaluation
    is_bad = poor(e.judged_fit, e.tests) or against_the_record(e)
    rules: tuple[_Rule, ...] = ()
    if (first := _logging_fault(result, is_bad)) is not None:
        return first
    if not e.fit.stop.converged or (e.joint_fit is not None and e.joint_fit.stopped):
        longer_search = _more_time(result)
        if longer_search is not None:  # what else may be wrong is seen after the whole search
            return longer_search
    if e.joint is not None and not e.joint.joint:
        rules = (_no_joint,)
    elif e.outputs:
        rules = (_budget, _nonlinear, _uncovered_validation, _coverage, _more_starts, _general) if is_bad else ()
    elif is_bad:  # what the structure cannot describe comes before what it has not seen
        rules = (_budget, _ends, _loop, _nonlinear, _uncovered_validation, _delay, _focus, _coverage, _more_starts)
        rules += (_search_structures, _other_kind)
    elif not e.fit.stop.converged:
        rules = (_more_starts,)
    elif e.tests is not None and not e.tests.white and not isinstance(e.setting.recipe, ActuatedJoint):
        rules = (_ends, _nonlinear, _search_structures)
    return next((step for rule in rules if (step := rule(result)) is not None), None)


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


_Rule = Callable[[Identification], NextStep | None]


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
    is_uncovered = _share_outside(e.estimation, e.validation) > MOST
    if is_uncovered or (e.joint is not None and e.joint.undetermined):
        record = result.record
        first = str(record.files[0] if record.files else record.path)  # an experiment follows from one record
        words = ["qpal", "design", first, *record.options]
        return NextStep("this record is too short to show a joint", shlex.join(words))
    reason = "the record is not that of an actuated joint"
    if result.selection is None:
        return NextStep(reason, command(result, structure="auto"))
    if not poor(e.judged_fit, e.tests):  # it predicts better than what the search passed over
        return None
    reason = f"{reason}, which the search chose"
    return NextStep(reason, command(result, structure=HammersteinWiener.name))


def _ends(result: Identification) -> NextStep | None:
    """The record rests at its ends and the model has no end stops; a structure search has tried a model with them."""
    recipe = result.evaluation.setting.recipe
    rests = next((a.sentence for a in result.advice if a.topic == "rest" and a.severity != "fine"), "")
    if not rests or result.selection is not None or isinstance(recipe, ActuatedJoint):
        return None
    if result.plan.preparation.filter[0] is not None:  # its volts and angles would not count from zero
        return None
    reason = f"{rests.partition(':')[0]}, and this model has no end stops"
    return NextStep(reason, command(result, structure=ActuatedJoint.name))


def _loop(result: Identification) -> NextStep | None:
    """A controller makes the input, or the plant integrates or is not stable: a model that predicts."""
    e = result.evaluation
    if e.fit.predicts or isinstance(e.setting.recipe, ActuatedJoint):
        return None
    if _in_loop(result):
        reason = "the input seems to come from a controller of the output"
    elif e.motion == Motion.STABLE:
        return None
    else:
        reason = "the plant seems to integrate, or is not stable"
    return NextStep(f"{reason}, where a free run says little", command(result, structure=Armax.name))


def _in_loop(result: Identification) -> bool:
    """Whether a controller seems to make the input of the output: an input then holds the error of its own sample."""
    topics = {a.topic: a for a in result.advice}
    feedback, delay, rate = (topics.get(t) for t in ("feedback", "delay", "rate"))
    at_once = delay is not None and delay.value == 0 and rate is not None and not np.isfinite(rate.value)
    return at_once or (feedback is not None and feedback.severity == "warning")


def _delay(result: Identification) -> NextStep | None:
    """Orders that cannot represent the delay of the record; a record of a closed loop does not show it."""
    recipe = result.evaluation.setting.recipe
    delays = [a.value for a in result.advice if a.topic == "delay" and np.isfinite(a.value)]
    if not {"nb", "nk"} <= set(recipe.orders) or result.selection is not None or not delays or _in_loop(result):
        return None
    delay, nk = int(delays[0]), recipe.orders["nk"]
    if _holds(recipe, delay):
        return None
    reason = f"the output responds after {delay} sample(s), but the model's delay is {nk}"
    return NextStep(reason, command(result, nk=delay))


def _holds(recipe: Recipe, delay: int) -> bool:
    """Whether a numerator of these orders can begin at the delay [samples]."""
    nk = recipe.orders["nk"]
    return nk <= delay < nk + recipe.orders["nb"]


def _focus(result: Identification) -> NextStep | None:
    """A nonlinear ARX model fitted for one-step-ahead prediction and poor in free run."""
    recipe = result.evaluation.setting.recipe
    if not isinstance(recipe, NonlinearArx) or recipe.focus != "prediction":
        return None
    return NextStep(
        "the model was fitted for one-step-ahead prediction and its free-run fit is poor",
        command(result, focus="simulation"),
    )


def _uncovered_validation(result: Identification) -> NextStep | None:
    """Validation data of which a large share is outside the range of the estimation data."""
    return (
        _coverage(result) if _share_outside(result.evaluation.estimation, result.evaluation.validation) > MUCH else None
    )


def _coverage(result: Identification) -> NextStep | None:
    """Validation data outside the range of the estimation data, and a split that corrects this."""
    e = result.evaluation
    if result.plan.validation is not None or not extrapolated_signals(e.estimation, e.validation):
        return None
    limit = _share_outside(e.estimation, e.validation) / 4
    for split in SPLITS:
        if split > result.split and _share_outside_split(result, split) <= limit:
            reason = (
                "the validation data leave the range of the estimation data; a longer estimation part covers more of it"
            )
            return NextStep(reason, command(result, split=split))
    return None


def _share_outside(estimation: IOData, validation: IOData) -> float:
    """The largest share over the signals of validation samples outside the range of the estimation data."""
    covered, new = (np.column_stack([part.u, part.y]) for part in (estimation, validation))
    return float(np.mean((new < covered.min(axis=0)) | (new > covered.max(axis=0)), axis=0).max())


def _share_outside_split(result: Identification, split: float) -> float:
    try:
        return _share_outside(*replace(result.plan, split=split).parts(result.record.data))
    except InputError:  # too short for this split
        return np.inf


def _nonlinear(result: Identification) -> NextStep | None:
    """A linear model of a nonlinear record."""
    linear = isinstance(result.evaluation.setting.recipe, OutputError)
    if not linear or result.selection is not None or not _nonlinear_record(result):
        return None
    reason = "the record is nonlinear, and this model is linear"
    return NextStep(reason, command(result, structure=HammersteinWiener.name))


def _nonlinear_record(result: Identification) -> bool:
    return any(a.topic == "nonlinearity" and a.severity == "note" and a.action for a in result.advice)


def _more_starts(result: Identification) -> NextStep | None:
    """A search that stopped early or had few starts."""
    stop, starts = result.evaluation.fit.stop, result.evaluation.setting.starts
    if result.evaluation.setting.held.start is not None:
        reason = "the search began at one saved fit only"
        return NextStep(reason, command(result, starts=STARTS, anew=True))
    wanted = STARTS if stop.converged else MORE_STARTS
    if starts >= wanted:
        return None
    reason = "the search had few starting points" if stop.converged else "the search did not converge"
    return NextStep(f"{reason} ({starts} starts)", command(result, starts=wanted))


def _general(result: Identification) -> NextStep | None:
    """The most general structure of several inputs and outputs."""
    if isinstance(result.evaluation.setting.recipe, NonlinearStateSpace):
        return None
    return NextStep("this structure does not explain the record", command(result, structure=NonlinearStateSpace.name))


def _search_structures(result: Identification) -> NextStep | None:
    """Another structure or size, by a search that validates candidates on data not used in their fit."""
    e = result.evaluation
    if result.selection is not None:
        return None
    reason = "this structure does not explain the record"
    if e.estimation_fit - e.validation_fit > OVERFITTED:
        reason = (
            "the two parts of the record differ"
            if has_ample_samples(e.fit)
            else "the model is too large for this record"
        )
    elif e.validation_fit >= POOR:
        reason = "the residuals are coloured, so the model is incomplete"
    return NextStep(reason, command(result, structure="auto", starts=2))


def _other_kind(result: Identification) -> NextStep | None:
    """No block model was found; a nonlinear ARX model does not assume blocks. A search has tried it already."""
    if result.selection is not None and any(r.candidate.name == NonlinearArx.name for r in result.selection.rows):
        return None
    return NextStep("no block structure explains the record", command(result, structure=NonlinearArx.name))


def command(
    result: Identification,
    structure: str | None = None,
    starts: int | None = None,
    split: float | None = None,
    anew: bool = False,
    seconds: float | None = None,
    **changed: Any,
) -> str:
    """The command that made `result`, with changes; a new `structure` uses its default orders and maps.

    `seconds` are the budget of the same search over structures, which goes on from its journal.
    `changed` are settings of the current structure; with them, or `anew`, the fit does not start from a saved one.
    """
    record, s = result.record, result.evaluation.setting
    auto = result.selection is not None and structure is None
    name = "auto" if auto else structure or s.recipe.name
    held = s.held.without_start() if anew or changed or structure is not None else s.held
    plan, files = result.plan, record.paths
    words = ["qpal", "identify", *map(str, files), *record.options, *_preparation_options(plan), "--structure", name]
    if structure is None and not auto:
        words += [*_options(replace(s.recipe, **changed)), *held.options()]
    # A structure whose record counts from zero has its own search, and nothing is removed from its record.
    kept = held.start is not None  # a saved fit is the only start
    lines = name == "auto" and result.detrend == "linear"  # which a search refuses
    own = bool(s.recipe.zero) or name == ActuatedJoint.name
    for option, value, default in (
        ("--search", "auto" if structure or own else s.search, "auto"),
        ("--split", "0.5" if plan.validation is not None else f"{split or result.split:g}", "0.5"),
        ("--detrend", "none" if own or lines else result.detrend, "none"),
        ("--starts", str(STARTS if kept else starts or (STARTS if structure else s.starts)), str(STARTS)),
        ("--seed", str(s.seed), "0"),
    ):
        words += [] if value == default else [option, value]
    selection = result.selection
    if auto and selection is not None and (seconds or selection.budget) != SECONDS:
        words += ["--seconds", f"{seconds or selection.budget:g}"]
    if seconds is not None and selection is not None and selection.journal is not None:
        words += ["--resume", str(selection.journal)]
    return shlex.join(words)


def _preparation_options(plan: Plan) -> list[str]:
    """The options of what came before the fit, but the share and the offsets."""
    words = list(replace(plan.preparation, detrend=None).options())
    validation = plan.validation
    for path in () if validation is None else validation.paths:
        words += ["--validation", str(path)]
    return words


def _options(recipe: Recipe) -> list[str]:
    """The options that give these settings."""
    words = ["--orders", ",".join(map(str, recipe.orders.values()))] if recipe.orders else []
    plain = type(recipe)()
    for name, option in recipe.options().items():
        value = getattr(recipe, name)
        if option.kind != "order" and value != getattr(plain, name):
            words += [f"--{name.replace('_', '-')}", f"{value:g}" if option.kind == "number" else value]
    return words


def _of_a_joint(advice: Advice, percent: float) -> Advice:
    """The same of the input of a joint, which has no orders and no input map: what its record needs.

    An input that is persistently exciting of order n has n / 2 frequencies (Ljung, System Identification, 1999, 13.2).
    """
    is_fine, sentence = advice.severity == "fine", advice.sentence.partition(":")[0]
    if advice.topic == "excitation":
        name, frequencies = sentence.partition(" is persistently")[0], int(np.ceil(advice.value / 2))
        word = "frequency" if frequencies == 1 else "frequencies"
        sentence = f"{name} has {frequencies} {word} {'or more' if is_fine else 'only'}"
    if is_fine:
        return replace(advice, sentence=sentence)
    command = ("design",) if percent >= POOR else ()  # which refuses what is no joint
    return replace(advice, sentence=sentence, action=JOINT_RECORD, call="", command=command)


def advice_after_fit(advice: Advice, fitted: Recipe, percent: float) -> Advice:
    """The finding without its action, if that names the fitted structure, or a weaker one than a structure that fits.

    `percent` is the fit in validation. A delay that the fitted orders cannot hold names these orders with it.
    """
    if isinstance(fitted, ActuatedJoint) and advice.topic in ("excitation", "levels"):
        return _of_a_joint(advice, percent)
    words = advice.command
    advised_structure = words[words.index("--structure") + 1] if "--structure" in words else ""
    if not advised_structure:
        return advice
    if advice.topic == "delay" and np.isfinite(delay := advice.value):
        if {"nb", "nk"} <= set(fitted.orders) and not _holds(fitted, int(delay)):
            if delay == 0 and isinstance(fitted, Armax | Arx):  # the sentence says that a controller may do the same
                return replace(advice, call="", command=())
            with_delay: dict[str, Any] = {"nk": int(delay)}
            options = _options(replace(fitted, **with_delay))
            return replace(advice, call="", command=("identify", "--structure", fitted.name, *options))
        return replace(advice, action="", call="", command=())
    weaker = _CLASSES.get(advised_structure, _RICHER) < _CLASSES.get(fitted.name, _RICHER)
    if advised_structure != fitted.name and not (weaker and percent >= POOR):
        return advice
    return replace(advice, action="", call="", command=())

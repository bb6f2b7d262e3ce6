"""What a finding on a record still says once a model was fitted to it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.diagnosis.finding import Advice
from sysid.diagnosis.residuals import POOR
from sysid.model.recipes import Recipe
from sysid.structures import (
    ActuatedJoint,
    Armax,
    Arx,
    BoxJenkins,
    Hammerstein,
    HammersteinWiener,
    OutputError,
    Wiener,
)
from sysid.workflow.changes import recipe_options
from sysid.workflow.remarks import JOINT_RECORD

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


def holds(recipe: Recipe, delay: int) -> bool:
    """Whether a numerator of these orders can begin at the delay [samples]."""
    nk = recipe.orders["nk"]
    return nk <= delay < nk + recipe.orders["nb"]


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
        if {"nb", "nk"} <= set(fitted.orders) and not holds(fitted, int(delay)):
            if delay == 0 and isinstance(fitted, Armax | Arx):  # the sentence says that a controller may do the same
                return replace(advice, call="", command=())
            with_delay: dict[str, Any] = {"nk": int(delay)}
            options = recipe_options(replace(fitted, **with_delay))
            return replace(advice, call="", command=("identify", "--structure", fitted.name, *options))
        return replace(advice, action="", call="", command=())
    weaker = _CLASSES.get(advised_structure, _RICHER) < _CLASSES.get(fitted.name, _RICHER)
    if advised_structure != fitted.name and not (weaker and percent >= POOR):
        return advice
    return replace(advice, action="", call="", command=())


def in_loop(findings: Sequence[Advice]) -> bool:
    """Whether a controller seems to make the input of the output: an input then holds the error of its own sample."""
    topics = {a.topic: a for a in findings}
    feedback, delay, rate = (topics.get(t) for t in ("feedback", "delay", "rate"))
    at_once = delay is not None and delay.value == 0 and rate is not None and not np.isfinite(rate.value)
    return at_once or (feedback is not None and feedback.severity == "warning")


def nonlinear(findings: Sequence[Advice]) -> bool:
    """Whether the record shows a nonlinearity that a map may explain."""
    return any(a.topic == "nonlinearity" and a.severity == "note" and a.action for a in findings)

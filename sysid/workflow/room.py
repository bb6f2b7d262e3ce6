"""Whether a record has samples for the parameters of a structure, and which structure it has them for."""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from sysid.base.errors import InputError, TooFewSamplesError
from sysid.data.record import IOData
from sysid.joint.full import full_joint
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe
from sysid.structures import TABLE, OutputError, ProcessModel
from sysid.workflow.changes import changed_setting
from sysid.workflow.plan import Plan
from sysid.workflow.results import Identification
from sysid.workflow.steps import NextStep

_EACH = 2  # samples a parameter: with fewer, unseen errors have more than three times the variance of the noise (FPE)


def parameters(recipe: Recipe, data: IOData) -> int:
    """Free parameters of what is fitted to `data`, of a structure with parts those of all of them; 0 if unknown."""
    model = recipe.model_of(data)
    if not isinstance(model, Chain):
        return 0
    return int((full_joint(model, data) if recipe.with_parts else model).free.sum())


def has_room(recipe: Recipe, data: IOData) -> bool:
    """Whether `data` have samples enough that the structure may predict others."""
    return int(data.observed.sum()) > _EACH * parameters(recipe, data)


def smaller(data: IOData) -> Recipe | None:
    """A structure of few parameters that `data` have samples for; None if there is none."""
    single = data.u.shape[1] == data.y.shape[1] == 1
    recipes: tuple[Recipe, ...] = (OutputError(), ProcessModel()) if single else (OutputError(),)
    return next((recipe for recipe in recipes if has_room(recipe, data)), None)


def with_room(result: Identification, steps: Iterable[NextStep]) -> list[NextStep]:
    """The steps without those to a structure that the estimation data have no samples for."""
    data = result.evaluation.estimation
    return [
        step
        for step in steps
        if step.change.get("structure") not in TABLE or has_room(changed_setting(result, **step.change).recipe, data)
    ]


@contextmanager
def told_of_parts(plan: Plan, estimation: IOData, samples: int) -> Iterator[None]:
    """A record that is too short is told with all of its samples, what was held back of them, and what has room."""
    try:
        yield
    except TooFewSamplesError as error:
        n, share = int(estimation.observed.sum()), 1.0
        found = f"{n} samples are"
        if plan.validation is None and not plan.whole:
            found, share = f"of {samples} samples --split {plan.split:g} leaves {n} for the fit, which are", plan.split
        other = smaller(estimation)
        first = "lower the orders"
        if other is not None and other.name != error.structure:
            first = f"give --structure {other.name}, which has {parameters(other, estimation)}"
        remedy = f"{first}, or record at least {math.ceil(error.least / share)} samples"
        what = f"the {error.parameters} free parameters of {error.structure}"
        raise InputError(f"{found} too few for {what}; {remedy}") from None

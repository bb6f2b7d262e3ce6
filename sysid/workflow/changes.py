"""A result with one thing changed: the command that makes it, and the same as a setting to fit."""

import shlex
from dataclasses import replace
from typing import Any

from sysid.estimation.objective import Objective
from sysid.model.recipes import Recipe
from sysid.selection.table import SECONDS
from sysid.structures import TABLE, ActuatedJoint
from sysid.workflow.plan import Plan
from sysid.workflow.results import Identification
from sysid.workflow.setting import Setting

STARTS = 5  # with fewer, another start may find more; from the second on it rarely does
AUTO = "auto"


def command(
    result: Identification,
    structure: str | None = None,
    starts: int | None = None,
    split: float | None = None,
    anew: bool = False,
    seconds: float | None = None,
    **changed: Any,
) -> str:
    """The command that made `result`, with changes; a new `structure` has its defaults where they do not say more.

    `seconds` are the budget of the same search over structures, which goes on from its journal.
    `changed` are settings of the current structure; with them, or `anew`, the fit does not start from a saved one.
    """
    record, selection, plan = result.record, result.selection, result.plan
    searches = structure == AUTO or (selection is not None and structure is None)
    words = ["qpal", "identify", *map(str, record.paths), *record.options, *_preparation_options(plan)]
    if searches:
        words += ["--structure", AUTO]
        s, name = result.evaluation.setting, AUTO
        search = s.search if structure is None else "auto"
        count, knots = starts or (STARTS if structure else s.starts), Objective.knots
    else:
        s = changed_setting(result, structure, starts, anew, **changed)
        name, search, count, knots = s.recipe.name, s.search, s.starts, s.knots
        words += [
            "--structure",
            name,
            *(recipe_options(s.recipe) if changed or not structure or s.recipe != type(s.recipe)() else []),
            *s.held.options(),
        ]
        count = STARTS if s.held.start is not None else count  # a saved fit is the only start
    for option, value, default in (
        ("--search", search, "auto"),
        ("--split", "0.5" if plan.validation is not None else f"{split or result.split:g}", "0.5"),
        ("--detrend", detrend_after(result, name), "none"),
        ("--starts", str(count), str(STARTS)),
        ("--seed", str(s.seed), "0"),
        ("--knots", str(knots), str(Objective.knots)),
    ):
        words += [] if value == default else [option, value]
    if searches and structure is None and selection is not None:
        words += ["--seconds", f"{seconds or selection.budget:g}"] if (seconds or selection.budget) != SECONDS else []
        if seconds is not None and selection.journal is not None:
            words += ["--resume", str(selection.journal)]
    return shlex.join(words)


def changed_setting(
    result: Identification, structure: str | None = None, starts: int | None = None, anew: bool = False, **changed: Any
) -> Setting:
    """How the command of the same changes fits, without a search over structures."""
    s = result.asked or result.evaluation.setting
    if structure is not None:
        kept = _shared(s.recipe, TABLE[structure]) | changed
        return Setting(TABLE[structure](**kept), starts=starts or STARTS, seed=s.seed, knots=s.knots)
    held = s.held.without_start() if anew or changed else s.held
    # A structure whose record counts from zero has its own search.
    search = "auto" if s.recipe.zero else s.search
    lost = held.start is None and s.held.start is not None
    count = starts or (STARTS if lost else s.starts)
    return Setting(replace(s.recipe, **changed), search, count, s.seed, held, knots=s.knots)


def _shared(recipe: Recipe, other: type[Recipe]) -> dict[str, Any]:
    """The settings but orders and maps that were given and that another structure has too."""
    plain, theirs = type(recipe)(), other.options()
    return {
        name: getattr(recipe, name)
        for name, option in recipe.options().items()
        if option.kind in ("name", "number") and theirs.get(name) == option
        if getattr(recipe, name) != getattr(plain, name)
    }


def detrend_after(result: Identification, structure: str) -> str:
    """What is removed before a fit of a structure: nothing where its signals count from zero, and no line by a search,
    which tries such structures too.
    """
    own = structure == ActuatedJoint.name or bool(result.evaluation.setting.recipe.zero)
    return "none" if own or (structure == AUTO and result.detrend == "linear") else result.detrend


def _preparation_options(plan: Plan) -> list[str]:
    """The options of what came before the fit, but the share and the offsets."""
    words = list(replace(plan.preparation, detrend=None).options())
    validation = plan.validation
    for path in () if validation is None else validation.paths:
        words += ["--validation", str(path)]
    return words


def recipe_options(recipe: Recipe) -> list[str]:
    """The options that give these settings."""
    words = ["--orders", ",".join(map(str, recipe.orders.values()))] if recipe.orders else []
    plain = type(recipe)()
    for name, option in recipe.options().items():
        value = getattr(recipe, name)
        if option.kind != "order" and value != getattr(plain, name):
            words += [f"--{name.replace('_', '-')}", f"{value:g}" if option.kind == "number" else value]
    return words

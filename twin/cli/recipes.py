"""Command-line options made from the fields of the model recipes."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.base.errors import InputError, unknown
from sysid.model.recipes import Option, Recipe
from sysid.structures import TABLE
from twin.cli import options

if TYPE_CHECKING:
    from sysid.estimation.result import Fit

DEFAULT = "hammerstein_wiener"
ORDERS = "orders"


def takes_recipes(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with **settings replaced by one option for each field of a recipe, after `structure`."""
    signature = inspect.signature(verb)
    parameters: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        if parameter.kind is not inspect.Parameter.VAR_KEYWORD:
            parameters.append(parameter)
        if parameter.name == "structure":
            parameters += [
                inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)
                for name, annotation in _annotations().items()
            ]
    verb.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return verb


def recipe(structure: str, values: Mapping[str, Any], start: "Fit | None" = None) -> Recipe:
    """The recipe `structure` with the given settings (None: not given), then those of a saved fit.

    Raises InputError for a setting that the recipe does not have.
    """
    structure = structure.replace("-", "_")  # tables print actuated-joint
    if structure not in TABLE:
        raise unknown("structure", structure, (*TABLE, "auto"))
    kind = TABLE[structure]
    settings = {name: value for name, value in values.items() if value is not None}
    for name in settings:
        if name not in _names(kind):
            alternatives = [candidate for candidate, recipe_type in TABLE.items() if name in _names(recipe_type)]
            raise InputError(
                f"--{_option_name(name)} is given with --structure {structure}, which has no {name.replace('_', ' ')}; "
                f"leave it out or give --structure {' or '.join(alternatives)}"
            )
    text = settings.pop(ORDERS, None)
    if text is not None:
        names = {name: kind.options()[name] for name in kind.of_kind("order")}
        settings |= options.orders(text, names, _example(kind))
    if start is not None:
        from sysid.workflow.setting import settings_of

        settings = settings_of(start, kind) | settings
    return kind(**settings)


def settings_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of the structure that a command names, as it describes them; none of no structure."""
    kind = TABLE.get(str(given.get("structure")).replace("-", "_"))
    if kind is None:
        return {}
    own = {n: _orders([kind]) if n == ORDERS else _annotation([kind.options()[n]]) for n in _names(kind)}
    return {name: annotation.__metadata__[0] for name, annotation in own.items()}


def refuse_settings(values: Mapping[str, Any], structure: str) -> None:
    """Raises InputError for a setting of one structure if `structure` starts a search."""
    for name, value in values.items():
        if value is not None:
            raise InputError(
                f"--{_option_name(name)} is given with --structure {structure}, which searches it; leave it out or "
                "name a structure"
            )


def _names(kind: type[Recipe]) -> list[str]:
    """Names of a recipe's settings; its orders are one."""
    orders = [ORDERS] if kind.of_kind("order") else []
    return orders + [name for name, option in kind.options().items() if option.kind != "order"]


def _annotations() -> dict[str, Any]:
    """Every setting of every recipe; the settings of the default recipe come first."""
    kinds = [TABLE[DEFAULT], *(kind for name, kind in TABLE.items() if name != DEFAULT)]
    by_name: dict[str, list[Option]] = {}
    for kind in kinds:
        for name in _names(kind):
            if name != ORDERS:
                by_name.setdefault(name, []).append(kind.options()[name])
    return {ORDERS: _orders(kinds), **{name: _annotation(descriptions) for name, descriptions in by_name.items()}}


def _orders(kinds: Iterable[type[Recipe]]) -> Any:
    """The option for orders: the first recipe's orders, the names of orders that differ, and all defaults."""
    first: dict[tuple[str, ...], type[Recipe]] = {}
    for kind in kinds:
        if kind.of_kind("order"):
            first.setdefault(kind.of_kind("order"), kind)
    (names, main_kind), *rest = first.items()
    words = [", ".join(main_kind.options()[name].help for name in names)]
    words += [f"of {kind.name} {','.join(order_names)}" for order_names, kind in rest]
    help = f"{'; '.join(words)} [{'; '.join(map(_example, first.values()))}]"
    return Annotated[str | None, typer.Option(metavar=",".join(names).upper(), help=help)]


def _annotation(descriptions: list[Option]) -> Any:
    """One option, from the descriptions of all recipes that have it."""
    help = ", or ".join(dict.fromkeys(option.help for option in descriptions))
    if descriptions[0].kind == "number":
        return Annotated[float | None, options.number(descriptions[0].unit, help)]
    choices = dict.fromkeys(
        name for option in descriptions for name in option.allowed
    )  # each recipe refuses the others'
    return Annotated[str | None, options.name(help, tuple(choices))]


def _example(kind: type[Recipe]) -> str:
    return ",".join(str(value) for value in kind().orders.values())


def _option_name(name: str) -> str:
    return name.replace("_", "-")

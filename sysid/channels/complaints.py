"""What pydantic found wrong with a mapping, as one sentence with what is allowed."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError

from sysid.base.errors import InputError

Where = tuple[str | int, ...]
MANY = 20  # names in a message
LONG = 60  # letters of a name in a message


class MappingError(InputError):
    """A mapping that is not allowed; `where` is the path to the entry within it, `said` the sentence about it."""

    def __init__(self, where: Where, said: str) -> None:
        self.where, self.said = where, said
        place = " ".join(f"{part + 1}" if isinstance(part, int) else part for part in where[:-1])
        super().__init__(f"{place}: {said}" if place else said)


_ONCE = (("clock",), ("repair",), ("range",))
_KINDS = {
    "float": "a number",
    "int": "a whole number",
    "string": "a text in quotes",
    "tuple": "two numbers in brackets",
    "model": "a table",
}


def complaint(error: ValidationError, kind: type[BaseModel]) -> tuple[Where, str]:
    """Where the first error is, within `kind`, and the sentence about it."""
    first = error.errors()[0]
    where, found, what, context = first["loc"], first["input"], first["type"], first.get("ctx", {})
    last = where[-1] if where else ""
    name = next((str(part) for part in reversed(where) if isinstance(part, str)), "")
    if what == "extra_forbidden":
        allowed = list(_model(kind, where[:-1]).model_fields)
        return where, f"unknown entry {brief(str(last))!r}; {closest(str(last), allowed)}"
    if what == "missing" and isinstance(last, int):
        return where[:-1], f"{name} has {last} number(s); give {_KINDS['tuple']}"
    if what == "missing":
        return where[:-1], f"{last} is missing; add {last} = ..."
    if what == "value_error":
        cause = context["error"]
        return ((*where, *cause.where), cause.said) if isinstance(cause, MappingError) else (where, str(cause))
    if what == "literal_error":
        return where, f"{name} is {shown(found)}; give {context['expected'].replace(chr(39), chr(34))}"
    if what in ("finite_number", "greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        signs = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
        bounds = [f"{word} {context[sign]:g}" for sign, word in signs.items() if sign in context]
        return where, f"{name} is {shown(found)}; give a finite number {' and '.join(bounds)}".rstrip()
    if what in ("too_short", "too_long"):
        return where, f"{name} is {shown(found)}; give {_KINDS['tuple']}"
    if what == "tuple_type" and len(where) == 1:
        return where, f"found one table [{name}]; write [[{name}]], since there may be several"
    if what.startswith("model") and where in _ONCE and isinstance(found, list):
        return where, f"found tables [[{name}]]; write [{name}], since there is one"
    kinds = next((words for key, words in _KINDS.items() if what.startswith(key)), "another value")
    return where, f"{name} is {shown(found)}; give {kinds}"


def one_of(choices: Sequence[Any]) -> str:
    """The allowed values as pydantic lists them."""
    texts = [f'"{each}"' if isinstance(each, str) else str(each) for each in choices]
    return f"{', '.join(texts[:-1])} or {texts[-1]}"


def closest(name: str, allowed: Sequence[str]) -> str:
    """The remedy for an unknown name: the ones most like it first, then all if they are few."""
    near = get_close_matches(name, allowed, n=3, cutoff=0.5)
    near += [each for each in allowed if each.lower() == name.lower() and each not in near]
    all_of_them = f"choose one of {listed(allowed)}" if len(allowed) <= MANY else ""
    nearest = f"the closest is {' or '.join(repr(brief(each)) for each in near)}" if near else ""
    return "; ".join(filter(None, [nearest, all_of_them])) or f"choose one of {listed(allowed)}"


def listed(names: Sequence[str]) -> str:
    """Names for a message: the first of many, and the beginnings of long ones."""
    more = f" and {len(names) - MANY} more" if len(names) > MANY else ""
    return ", ".join(brief(name) for name in names[:MANY]) + more


def brief(name: str) -> str:
    """A name, or the beginning of a long one."""
    return name if len(name) <= LONG else name[: LONG - 3] + "..."


def shown(value: Any) -> str:
    """A value as a message shows it: short."""
    if isinstance(value, BaseModel | dict):
        return "a table"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _model(kind: type[BaseModel], where: Where) -> type[BaseModel]:
    """The model of the table at `where`."""
    for part in where:
        if isinstance(part, str):
            inner = kind.model_fields[part].annotation
            kind = next(each for each in _models(inner))
    return kind


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for each in getattr(annotation, "__args__", ()) for found in _models(each)]

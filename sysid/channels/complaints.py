"""What pydantic found wrong with a mapping as one sentence with what is allowed; names and values in messages."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError

from sysid.base.errors import InputError

Place = tuple[str | int, ...]
MANY = 20  # names in a message
LONG = 60  # letters of a name in a message


class MappingError(InputError):
    """A mapping that is not allowed; `place` is the path to the entry within it, `sentence` what is wrong with it."""

    def __init__(self, place: Place, sentence: str) -> None:
        self.place, self.sentence = place, sentence
        table = " ".join(f"{part + 1}" if isinstance(part, int) else part for part in place[:-1])
        super().__init__(f"{table}: {sentence}" if table else sentence)


_ONCE = (("clock",), ("repair",), ("range",))
_KINDS = {
    "float": "a number",
    "int": "a whole number",
    "string": "a text in quotes",
    "tuple": "two numbers in brackets",
    "model": "a table",
}


def complaint(error: ValidationError, kind: type[BaseModel]) -> tuple[Place, str]:
    """Where the first error is, within `kind`, and the sentence about it."""
    first = error.errors()[0]
    place, value, kind_of_error, context = first["loc"], first["input"], first["type"], first.get("ctx", {})
    last = place[-1] if place else ""
    name = next((str(part) for part in reversed(place) if isinstance(part, str)), "")
    if kind_of_error == "extra_forbidden":
        allowed = list(_model(kind, place[:-1]).model_fields)
        return place, f"unknown entry {brief(str(last))!r}; {closest(str(last), allowed)}"
    if kind_of_error == "missing" and isinstance(last, int):
        return place[:-1], f"{name} has {last} number(s); give {_KINDS['tuple']}"
    if kind_of_error == "missing":
        return place[:-1], f"{last} is missing; add {last} = ..."
    if kind_of_error == "value_error":
        cause = context["error"]
        return ((*place, *cause.place), cause.sentence) if isinstance(cause, MappingError) else (place, str(cause))
    if kind_of_error == "literal_error":
        return place, f"{name} is {brief_value(value)}; give {context['expected'].replace(chr(39), chr(34))}"
    if kind_of_error in ("finite_number", "greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        signs = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
        bounds = [f"{word} {context[sign]:g}" for sign, word in signs.items() if sign in context]
        return place, f"{name} is {brief_value(value)}; give a finite number {' and '.join(bounds)}".rstrip()
    if kind_of_error in ("too_short", "too_long"):
        return place, f"{name} is {brief_value(value)}; give {_KINDS['tuple']}"
    if kind_of_error == "tuple_type" and len(place) == 1:
        return place, f"found one table [{name}]; write [[{name}]], since there may be several"
    if kind_of_error.startswith("model") and place in _ONCE and isinstance(value, list):
        return place, f"found tables [[{name}]]; write [{name}], since there is one"
    kinds = next((words for key, words in _KINDS.items() if kind_of_error.startswith(key)), "another value")
    return place, f"{name} is {brief_value(value)}; give {kinds}"


def choices_text(choices: Sequence[Any]) -> str:
    """The allowed values as pydantic lists them."""
    texts = [f'"{choice}"' if isinstance(choice, str) else str(choice) for choice in choices]
    return f"{', '.join(texts[:-1])} or {texts[-1]}"


def closest(name: str, choices: Sequence[str]) -> str:
    """The remedy for an unknown name: the ones most like it first, then all if they are few."""
    matches = get_close_matches(name, choices, n=3, cutoff=0.5)
    matches += [choice for choice in choices if choice.lower() == name.lower() and choice not in matches]
    every_choice = f"choose one of {list_names(choices)}" if len(choices) <= MANY else ""
    nearest = f"the closest is {' or '.join(repr(brief(choice)) for choice in matches)}" if matches else ""
    return "; ".join(filter(None, [nearest, every_choice])) or f"choose one of {list_names(choices)}"


def list_names(names: Sequence[str]) -> str:
    """Names for a message: the first of many, and the beginnings of long ones."""
    rest = f" and {len(names) - MANY} more" if len(names) > MANY else ""
    return ", ".join(brief(name) for name in names[:MANY]) + rest


def brief(name: str) -> str:
    """A name, or the beginning of a long one."""
    return name if len(name) <= LONG else name[: LONG - 3] + "..."


def brief_value(value: Any) -> str:
    """A value as a message shows it: short."""
    if isinstance(value, BaseModel | dict):
        return "a table"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _model(kind: type[BaseModel], place: Place) -> type[BaseModel]:
    """The model of the table at `place`."""
    for part in place:
        if isinstance(part, str):
            inner = kind.model_fields[part].annotation
            kind = next(each for each in _models(inner))
    return kind


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in getattr(annotation, "__args__", ()) for model in _models(argument)]

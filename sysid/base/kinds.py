"""What a value of an argument may be: the kinds of `sysid.base.checks`, each with what to say of another value."""

import dataclasses
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from types import NoneType
from typing import Any

import numpy as np

SIZE = 1e151  # of a value: sums of squares of a record are still numbers; fits refuse larger ones too


class RefusedValue(Exception):  # noqa: N818 - it is caught by `checks`, which writes the sentence
    """A value that an annotation does not allow; `allowed` says what to give.

    `is_argument`: it is the argument itself, not a value inside it.
    """

    def __init__(self, value: Any, allowed: str, is_argument: bool = True) -> None:
        super().__init__(allowed)
        self.value, self.allowed, self.is_argument = value, allowed, is_argument


@dataclasses.dataclass(frozen=True)
class Kind:
    """What an argument may be, in `words`; `convert` gives a value in the form that the function takes.

    `convert` raises RefusedValue for a value of another kind.
    """

    words: str
    convert: Callable[[Any], Any]


@dataclasses.dataclass(frozen=True)
class Span:
    """The numbers from `lowest` to `highest`; `above` leaves `lowest` itself out. `infinite`: inf is allowed too.

    `say` is what to give instead of another number, where that says it better than the limits do.
    """

    lowest: float = -SIZE
    highest: float = SIZE
    above: bool = False
    infinite: bool = False
    say: str = ""

    def holds(self, value: float) -> bool:
        """Whether a number lies in it; nan does not."""
        if isinstance(value, float) and math.isinf(value):
            return self.infinite and self.lowest <= value <= math.inf
        return bool((value > self.lowest if self.above else value >= self.lowest) and value <= self.highest)

    def allowed(self, value: float, noun: str) -> str:
        """What to give instead of `value`, in words."""
        if self.say:
            return self.say
        if value != value or abs(value) == math.inf:
            return f"a finite {noun}"
        if value > self.highest:
            return f"a {noun} up to {_limit_text(self.highest)}"
        if self.above:
            return f"a {noun} above {_limit_text(self.lowest)}"
        return f"a {noun} of at least {_limit_text(self.lowest)}"


def _limit_text(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


ANY = Span()


class Named:
    """Stands for a class that is imported for type checkers only; a value is of it by the name of its class."""


_WHOLE = 2**53  # up to it every whole number is a float


def is_number(value: Any) -> bool:
    """Whether it is one real number, and no yes or no."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return value.dtype.kind in "iuf"
    return isinstance(value, Real) and not isinstance(value, (bool, np.bool_, np.timedelta64))


def number(kind: type, span: Span) -> Kind:
    noun = "whole number" if kind is int else "number"

    def convert(value: Any) -> Any:
        if isinstance(value, np.ndarray) and value.ndim == 0 and is_number(value):
            value = value[()]
        if not is_number(value) or (kind is int and not isinstance(value, Integral)):
            raise RefusedValue(value, f"a {noun}")
        plain = int(value) if isinstance(value, Integral) else float(value)  # NumPy's small integers wrap around
        if not span.holds(plain):
            raise RefusedValue(value, span.allowed(plain, noun))
        # NumPy knows no whole numbers beyond 64 bits.
        return float(plain) if kind is float and abs(plain) > _WHOLE else plain

    return Kind(f"a {noun}", convert)


def _array(value: Any) -> Any:
    """Real, finite numbers as an array."""
    if isinstance(value, np.ma.MaskedArray) and np.any(np.ma.getmaskarray(value)):
        raise RefusedValue(value, "an array without masked values")
    if isinstance(value, (str, bytes, Mapping, set, type)) or value is None:
        raise RefusedValue(value, "an array of numbers")
    try:
        array = np.asarray(value)
    except MemoryError:
        raise
    except Exception:  # an array of another library raises what it likes: a tensor that records gradients, RuntimeError
        raise RefusedValue(value, "an array of numbers, its rows of one length") from None
    if array.dtype.kind not in "biuf":
        raise RefusedValue(value, "an array of real numbers")
    if array.dtype.kind == "f" and not np.all(np.isfinite(array)):
        bad = int(np.argmin(np.isfinite(array).ravel()))
        raise RefusedValue(value, f"finite numbers (entry {bad}, from 0, is {array.ravel()[bad]})")
    if array.size and array.dtype.kind == "f" and float(np.abs(array).max()) > ANY.highest:
        raise RefusedValue(value, f"numbers of at most {ANY.highest:g}")
    return value if type(value) is np.ndarray else array


def _text(value: Any) -> Any:
    if not isinstance(value, str):
        raise RefusedValue(value, "a text")
    return value


def _path(value: Any) -> Any:
    if not isinstance(value, (str, os.PathLike)):
        raise RefusedValue(value, "the path of a file, as a text")
    text = os.fspath(value)
    if not text or (isinstance(text, str) and "\0" in text):
        raise RefusedValue(value, "the path of a file; this one is empty or has a character of code 0")
    return value


def _flag(value: Any) -> Any:
    if isinstance(value, (bool, np.bool_)) or (isinstance(value, Integral) and value in (0, 1)):
        return bool(value)
    raise RefusedValue(value, "True or False")


def _none(value: Any) -> Any:
    if value is not None:
        raise RefusedValue(value, "None")
    return value


def _call(value: Any) -> Any:
    if not callable(value) or isinstance(value, type):
        raise RefusedValue(value, "a function")
    return value


def instance(kind: type) -> Kind:
    def convert(value: Any) -> Any:
        by_name = issubclass(kind, Named) and kind.__name__ in (k.__name__ for k in type(value).__mro__)
        if not by_name and not isinstance(value, kind):
            raise RefusedValue(value, words)
        return value

    name = kind.__name__.lstrip("_")
    words = f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
    return Kind(words, convert)


def one_of(allowed: tuple[Any, ...]) -> Kind:
    words = "one of " + ", ".join(map(repr, allowed))

    def convert(value: Any) -> Any:
        if not any(type(value) is type(each) and value == each for each in allowed):
            raise RefusedValue(value, words)
        return value

    return Kind(words, convert)


def one_kind_of(kinds: list[Kind]) -> Kind:
    words = " or ".join(dict.fromkeys(each.words for each in kinds))

    def convert(value: Any) -> Any:
        closest = ""
        for each in kinds:
            try:
                return each.convert(value)
            except RefusedValue as refused:
                if refused.allowed != each.words:  # of the right type, but too large or the like
                    closest = closest or refused.allowed
        raise RefusedValue(value, closest or words)

    return Kind(words, convert)


def mapping(values: Kind) -> Kind:
    def convert(value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise RefusedValue(value, "a dict")
        for key, each in value.items():
            if not isinstance(key, str):
                raise RefusedValue(key, "names as the keys of a dict", is_argument=False)
            _inside(values, each)
        return value

    return Kind("a dict", convert)


def _inside(kind: Kind, value: Any) -> Any:
    try:
        return kind.convert(value)
    except RefusedValue as refused:
        allowed = refused.allowed if refused.allowed.endswith(" for each") else f"{refused.allowed} for each"
        raise RefusedValue(refused.value, allowed, is_argument=False) from None


def several(inside: Kind, kind: Any) -> Kind:
    words = f"a {'tuple' if kind is tuple else 'list'} with {inside.words} for each" if inside.words else "a list"

    def convert(value: Any) -> Any:
        if isinstance(value, (str, bytes, Mapping, set, type)) or not isinstance(value, Iterable):
            raise RefusedValue(value, words)
        if isinstance(value, np.ndarray) and value.ndim == 0:
            raise RefusedValue(value, words)
        if not isinstance(value, (list, tuple, np.ndarray)):
            if isinstance(value, Sequence) or kind not in (tuple, list, Sequence):
                return value
            return convert(tuple(value) if kind is tuple else list(value))  # a generator has no length
        values = [_inside(inside, each) for each in value]
        return tuple(values) if kind is tuple else value

    return Kind(words, convert)


def row(kinds: list[Kind]) -> Kind:
    words = f"{len(kinds)} values: " + ", ".join(each.words for each in kinds)

    def convert(value: Any) -> Any:
        if not isinstance(value, (list, tuple, np.ndarray)) or (isinstance(value, np.ndarray) and value.ndim == 0):
            raise RefusedValue(value, words)
        if len(value) != len(kinds):
            raise RefusedValue(value, words)
        return tuple(_inside(kind, each) for kind, each in zip(kinds, value, strict=True))

    return Kind(words, convert)


ANYTHING = Kind("", lambda value: value)
PATH = Kind("the path of a file, as a text", _path)
CALLABLE = Kind("a function", _call)
ARRAY = Kind("an array of numbers", _array)
PLAIN: dict[Any, Kind] = {
    str: Kind("a text", _text),
    bool: Kind("True or False", _flag),
    None: Kind("None", _none),
    NoneType: Kind("None", _none),
    np.ndarray: ARRAY,
}

"""What an annotation allows: the kinds of `sysid.base.checks`, each with what to say if a value is of another."""

import builtins
import collections.abc
import dataclasses
import inspect
import os
import sys
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import PurePath
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from sysid.base.limits import ANY, BY_NAME, OF_EACH, Span


class Wrong(Exception):  # noqa: N818 - it is caught by `checks`, which writes the sentence
    """A value that an annotation does not allow; `allowed` says what to give. `whole`: it is the argument itself."""

    def __init__(self, value: Any, allowed: str, whole: bool = True) -> None:
        super().__init__(allowed)
        self.value, self.allowed, self.whole = value, allowed, whole


@dataclasses.dataclass(frozen=True)
class Kind:
    """`made` gives the value in the form that the function takes, or raises Wrong; `words` say what it allows."""

    words: str
    made: Callable[[Any], Any]


class Named:
    """Stands for a class that is imported for type checkers only; a value is of it by the name of its class."""


class _Names(dict[str, Any]):
    """The names of a module; one that it does not have stands for a class of that name."""

    def __missing__(self, name: str) -> Any:
        found = getattr(collections.abc, name, None) or getattr(typing, name, None)
        return found if found is not None else type(name, (Named,), {})


def namespace(function: Callable[..., Any], owner: type | None) -> dict[str, Any]:
    """The names that annotations of a function, or of the fields of `owner`, may use."""
    names = _Names({**vars(builtins), "np": np, "os": os})
    for kind in reversed(owner.__mro__ if owner is not None else ()):
        names.update(vars(sys.modules[kind.__module__]))
    names.update(getattr(inspect.unwrap(function), "__globals__", {}))
    return names


def kind_of(annotation: Any, name: str, names: dict[str, Any]) -> Kind:
    """The kind of an argument called `name`."""
    if isinstance(annotation, typing.ForwardRef):
        annotation = annotation.__forward_arg__
    if isinstance(annotation, str):
        try:
            return kind_of(eval(annotation, {}, names), name, names)
        except (NameError, TypeError, SyntaxError, AttributeError):
            return ANYTHING
    if annotation in (Any, inspect.Parameter.empty, object):
        return ANYTHING
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    if annotation in (int, float):
        return _number(annotation, BY_NAME.get(name, ANY))
    origin, inside = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        kinds = [kind_of(each, name, names) for each in inside]
        return _either([k for k in kinds if k is not _PLAIN[str]] if PATH in kinds else kinds)
    if origin is typing.Annotated:
        return kind_of(inside[0], name, names)
    if origin is Literal:
        return _one_of(inside)
    if origin in (os.PathLike,) or (isinstance(annotation, type) and issubclass(annotation, (os.PathLike, PurePath))):
        return PATH
    if origin is collections.abc.Callable or annotation is collections.abc.Callable:
        return CALLABLE
    bare, each_name = origin or annotation, name if name in OF_EACH else ""
    if isinstance(bare, type) and issubclass(bare, Mapping):
        return _mapping(kind_of(inside[1], each_name, names) if len(inside) == 2 else ANYTHING)
    if bare is tuple and inside and inside[-1] is not Ellipsis:
        return _row([kind_of(each, each_name, names) for each in inside])
    if bare in (tuple, list, Sequence, Iterable, collections.abc.Collection):
        return _several(kind_of(inside[0], each_name, names) if inside else ANYTHING, bare)
    return _instance(bare) if isinstance(bare, type) and not _protocol(bare) else ANYTHING


def _protocol(kind: type) -> bool:
    return bool(getattr(kind, "_is_protocol", False))


_WHOLE = 2**53  # up to it every whole number is a float


def is_number(value: Any) -> bool:
    """Whether it is one real number, and no yes or no."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return value.dtype.kind in "iuf"
    return isinstance(value, Real) and not isinstance(value, (bool, np.bool_, np.timedelta64))


def _number(kind: type, span: Span) -> Kind:
    noun = "whole number" if kind is int else "number"

    def made(value: Any) -> Any:
        if isinstance(value, np.ndarray) and value.ndim == 0 and is_number(value):
            value = value[()]
        if not is_number(value) or (kind is int and not isinstance(value, Integral)):
            raise Wrong(value, f"a {noun}")
        plain = int(value) if isinstance(value, Integral) else float(value)  # NumPy's small integers wrap around
        if not span.holds(plain):
            raise Wrong(value, span.allowed(plain, noun))
        # NumPy knows no whole numbers beyond 64 bits.
        return float(plain) if kind is float and abs(plain) > _WHOLE else plain

    return Kind(f"a {noun}", made)


def _array(value: Any) -> Any:
    """Real, finite numbers as an array."""
    if isinstance(value, np.ma.MaskedArray) and np.any(np.ma.getmaskarray(value)):
        raise Wrong(value, "an array without masked values")
    if isinstance(value, (str, bytes, Mapping, set, type)) or value is None:
        raise Wrong(value, "an array of numbers")
    try:
        found = np.asarray(value)
    except MemoryError:
        raise
    except Exception:  # an array of another library raises what it likes: a tensor that records gradients, RuntimeError
        raise Wrong(value, "an array of numbers, its rows of one length") from None
    if found.dtype.kind not in "biuf":
        raise Wrong(value, "an array of real numbers")
    if found.dtype.kind == "f" and not np.all(np.isfinite(found)):
        bad = int(np.argmin(np.isfinite(found).ravel()))
        raise Wrong(value, f"finite numbers (entry {bad}, from 0, is {found.ravel()[bad]})")
    if found.size and found.dtype.kind == "f" and float(np.abs(found).max()) > ANY.highest:
        raise Wrong(value, f"numbers of at most {ANY.highest:g}")
    return value if type(value) is np.ndarray else found


def _text(value: Any) -> Any:
    if not isinstance(value, str):
        raise Wrong(value, "a text")
    return value


def _path(value: Any) -> Any:
    if not isinstance(value, (str, os.PathLike)):
        raise Wrong(value, "the path of a file, as a text")
    text = os.fspath(value)
    if not text or (isinstance(text, str) and "\0" in text):
        raise Wrong(value, "the path of a file; this one is empty or has a character of code 0")
    return value


def _flag(value: Any) -> Any:
    if isinstance(value, (bool, np.bool_)) or (isinstance(value, Integral) and value in (0, 1)):
        return bool(value)
    raise Wrong(value, "True or False")


def _none(value: Any) -> Any:
    if value is not None:
        raise Wrong(value, "None")
    return value


def _call(value: Any) -> Any:
    if not callable(value) or isinstance(value, type):
        raise Wrong(value, "a function")
    return value


def _instance(kind: type) -> Kind:
    def made(value: Any) -> Any:
        by_name = issubclass(kind, Named) and kind.__name__ in (k.__name__ for k in type(value).__mro__)
        if not by_name and not isinstance(value, kind):
            raise Wrong(value, words)
        return value

    name = kind.__name__.lstrip("_")
    words = f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
    return Kind(words, made)


def _one_of(allowed: tuple[Any, ...]) -> Kind:
    words = "one of " + ", ".join(map(repr, allowed))

    def made(value: Any) -> Any:
        if not any(type(value) is type(each) and value == each for each in allowed):
            raise Wrong(value, words)
        return value

    return Kind(words, made)


def _either(kinds: list[Kind]) -> Kind:
    words = " or ".join(dict.fromkeys(each.words for each in kinds))

    def made(value: Any) -> Any:
        closest = ""
        for each in kinds:
            try:
                return each.made(value)
            except Wrong as wrong:
                if wrong.allowed != each.words:  # of the right type, but too large or the like
                    closest = closest or wrong.allowed
        raise Wrong(value, closest or words)

    return Kind(words, made)


def _mapping(values: Kind) -> Kind:
    def made(value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise Wrong(value, "a dict")
        for key, each in value.items():
            if not isinstance(key, str):
                raise Wrong(key, "names as the keys of a dict", whole=False)
            _inside(values, each)
        return value

    return Kind("a dict", made)


def _inside(kind: Kind, value: Any) -> Any:
    try:
        return kind.made(value)
    except Wrong as wrong:
        allowed = wrong.allowed if wrong.allowed.endswith(" for each") else f"{wrong.allowed} for each"
        raise Wrong(wrong.value, allowed, whole=False) from None


def _several(inside: Kind, kind: Any) -> Kind:
    words = f"a {'tuple' if kind is tuple else 'list'} with {inside.words} for each" if inside.words else "a list"

    def made(value: Any) -> Any:
        if isinstance(value, (str, bytes, Mapping, set, type)) or not isinstance(value, Iterable):
            raise Wrong(value, words)
        if isinstance(value, np.ndarray) and value.ndim == 0:
            raise Wrong(value, words)
        if not isinstance(value, (list, tuple, np.ndarray)):
            if isinstance(value, Sequence) or kind not in (tuple, list, Sequence):
                return value
            return made(tuple(value) if kind is tuple else list(value))  # a generator has no length
        found = [_inside(inside, each) for each in value]
        return tuple(found) if kind is tuple else value

    return Kind(words, made)


def _row(kinds: list[Kind]) -> Kind:
    words = f"{len(kinds)} values: " + ", ".join(each.words for each in kinds)

    def made(value: Any) -> Any:
        if isinstance(value, (str, bytes)) or not isinstance(value, (list, tuple, np.ndarray)) or np.ndim(value) == 0:
            raise Wrong(value, words)
        if len(value) != len(kinds):
            raise Wrong(value, words)
        return tuple(_inside(kind, each) for kind, each in zip(kinds, value, strict=True))

    return Kind(words, made)


ANYTHING = Kind("", lambda value: value)
PATH = Kind("the path of a file, as a text", _path)
CALLABLE = Kind("a function", _call)
ARRAY = Kind("an array of numbers", _array)
_PLAIN: dict[Any, Kind] = {
    str: Kind("a text", _text),
    bool: Kind("True or False", _flag),
    None: Kind("None", _none),
    NoneType: Kind("None", _none),
    np.ndarray: ARRAY,
}

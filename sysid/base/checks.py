"""Arguments of public calls, checked against their annotations before the work begins.

`checked` reads the annotations of a function or the fields of a dataclass. What a value may be is said by its type, and
for a number by its name in `sysid.base.limits`. An argument that a function judges itself, with a better sentence, is
named in `deferred`: it is looked at here only if the call ends in an error that is no sentence.
"""

import builtins
import collections.abc
import dataclasses
import functools
import inspect
import os
import sys
import typing
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from pathlib import PurePath
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, overload

import numpy as np

from sysid.base.errors import InputError
from sysid.base.kinds import (
    ANY,
    ANYTHING,
    ARRAY,
    CALLABLE,
    PATH,
    PLAIN,
    Kind,
    Named,
    RefusedValue,
    Span,
    instance,
    is_number,
    mapping,
    number,
    one_kind_of,
    one_of,
    row,
    several,
)
from sysid.base.limits import BY_NAME, OF_EACH

C = TypeVar("C", bound=Callable[..., Any])
_UNTYPED = (TypeError, ValueError, KeyError, IndexError, AttributeError, ArithmeticError, MemoryError, AssertionError)


@overload
def checked(target: C) -> C: ...


@overload
def checked(*, deferred: tuple[str, ...] = (), late: bool = False) -> Callable[[C], C]: ...


def checked(target: Any = None, *, deferred: tuple[str, ...] = (), late: bool = False) -> Any:
    """The function or the dataclass, which raises InputError for arguments that its annotations do not allow.

    Lists and tables of numbers are made arrays where the annotation is an array, and tuples where it is a tuple. With
    `late` every argument of a function is looked at only after an error, for a call that is made in every step of a
    search; a class with `late` says its own sentence first, and then what its annotations do not allow.
    """
    if target is None:
        return lambda target: _check_function_or_class(target, deferred, late)
    return _check_function_or_class(target, deferred, late)


def _check_function_or_class(target: Any, deferred: tuple[str, ...], late: bool) -> Any:
    if isinstance(target, type):
        target.__init__ = _with_checks(target.__init__, deferred, late, target)  # type: ignore[misc]
        return target
    return _with_checks(target, deferred, late, None)


def _with_checks(
    function: Callable[..., Any], deferred: tuple[str, ...], late: bool, owner: type | None
) -> Callable[..., Any]:
    signature = inspect.signature(function)

    @functools.cache
    def kinds() -> dict[str, Kind]:
        """The kind of each argument, read at the first call: annotations may name what is imported later."""
        names = namespace(function, owner)
        return {p.name: kind_of(p.annotation, p.name, names) for p in signature.parameters.values()}

    def convert_arguments(call: inspect.BoundArguments, names: Container[str] | None) -> None:
        """Every argument, or those of `names`, in its form."""
        for name, value in call.arguments.items():
            if names is None or name in names:
                call.arguments[name] = _convert_argument(kinds()[name], name, value, signature.parameters[name])

    early = tuple(name for name in signature.parameters if name not in deferred)
    sizes = {name: BY_NAME[name] for name in deferred if name in BY_NAME}

    @functools.wraps(function)
    def checked_call(*args: Any, **kwargs: Any) -> Any:
        try:
            if late and owner is None:
                return function(*args, **kwargs)
            call = _bind(signature, args, kwargs)
            if call is None:
                return function(*args, **kwargs)
            try:
                convert_arguments(call, early)
            except InputError:
                if late:
                    function(*args, **kwargs)
                raise
            for name in deferred:
                if is_number(call.arguments.get(name)):
                    call.arguments[name] = _python_number(call.arguments[name])
            _check_sizes(sizes, call.arguments)
            return function(*call.args, **call.kwargs)
        except InputError:
            raise
        except _UNTYPED:
            call = _bind(signature, args, kwargs)
            if call is not None:
                convert_arguments(call, None if late else deferred)
                _check_arrays(kinds(), call.arguments)
            raise

    return checked_call


def check_fields(record: Any) -> None:
    """Raises InputError for a field of a dataclass that its annotation does not allow; it may stay as it is call."""
    kind_of_record: Any = type(record)
    for name, kind in _kinds_of_fields(kind_of_record).items():
        try:
            kind.convert(getattr(record, name))
        except RefusedValue as refused:
            where = f"{name} of a {type(record).__name__} {'is' if refused.is_argument else 'has'}"
            raise InputError(f"{where} {short_text(refused.value)}; give {refused.allowed}") from None


@functools.cache
def _kinds_of_fields(kind: Any) -> dict[str, Kind]:
    names = namespace(kind.__init__, kind)
    return {f.name: kind_of(f.type, f.name, names) for f in dataclasses.fields(kind) if f.init}


def _python_number(value: Any) -> int | float:
    """A number as Python's deferred: NumPy's small integers wrap around, and a fraction cannot be formatted."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.item()
    return value if isinstance(value, (int, float)) else float(value)


def _check_sizes(sizes: Mapping[str, Span], call: Mapping[str, Any]) -> None:
    """Raises InputError for a number beyond its limit; all else about it the function says itself."""
    for name, span in sizes.items():
        value: Any = call.get(name)
        if is_number(value) and span.highest < value < np.inf:
            raise InputError(f"{name} is {short_text(value)}; give {span.allowed(value, 'number')}")


def _check_arrays(kinds: Mapping[str, Kind], call: Mapping[str, Any]) -> None:
    """After an error: raises InputError for one number in place of an array, which many functions take too."""
    for name, value in call.items():
        if ARRAY.words in kinds[name].words and value is not None and np.ndim(value) == 0:
            raise InputError(f"{name} is {short_text(value)}; give {ARRAY.words}")


def _bind(signature: inspect.Signature, args: Any, kwargs: Any) -> inspect.BoundArguments | None:
    """The arguments by name; None where Python itself says best which one is missing or unknown."""
    try:
        return signature.bind(*args, **kwargs)
    except TypeError:
        return None


def _convert_argument(kind: Kind, name: str, value: Any, parameter: inspect.Parameter) -> Any:
    """The value in the form that the function takes; raises InputError if there is none."""
    try:
        if parameter.kind is parameter.VAR_POSITIONAL:
            return tuple(kind.convert(each) for each in value)
        if parameter.kind is parameter.VAR_KEYWORD:
            return {key: kind.convert(each) for key, each in value.items()}
        return kind.convert(value)
    except RefusedValue as refused:
        where = f"{name} is" if refused.is_argument else f"{name} has"
        raise InputError(f"{where} {short_text(refused.value)}; give {refused.allowed}") from None


def array(name: str, value: Any) -> np.ndarray:
    """Real, finite numbers as an array of floats; raises InputError for anything else. `name` is the argument's."""
    try:
        return np.asarray(ARRAY.convert(value), dtype=float)
    except RefusedValue as refused:
        raise InputError(f"{name} is {short_text(refused.value)}; give {refused.allowed}") from None


def short_text(value: Any) -> str:
    """A value in a sentence: short, on one line."""
    if isinstance(value, np.ndarray) and value.ndim:
        masked = "a masked array" if isinstance(value, np.ma.MaskedArray) else "an array"
        return f"{masked} of shape {value.shape} and type {value.dtype}"
    if isinstance(value, (str, bytes, int, float, complex, type(None), np.generic, list, tuple, dict, Mapping)):
        try:
            text = repr(value)
        except ValueError:  # Python writes no whole number of more than 4300 digits
            return "a number of thousands of digits"
        text = " ".join(text.split())
        return text if len(text) <= 60 else f"{text[:50]}... ({type(value).__name__})"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"a {type(value).__name__}"


class _Names(dict[str, Any]):
    """The names of a module; one that it does not have stands for a class of that name."""

    def __missing__(self, name: str) -> Any:
        kind = getattr(collections.abc, name, None) or getattr(typing, name, None)
        return kind if kind is not None else type(name, (Named,), {})


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
    if annotation in PLAIN:
        return PLAIN[annotation]
    if annotation in (int, float):
        return number(annotation, BY_NAME.get(name, ANY))
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        kinds = [kind_of(each, name, names) for each in arguments]
        return one_kind_of([k for k in kinds if k is not PLAIN[str]] if PATH in kinds else kinds)
    if origin is typing.Annotated:
        return kind_of(arguments[0], name, names)
    if origin is Literal:
        return one_of(arguments)
    if origin in (os.PathLike,) or (isinstance(annotation, type) and issubclass(annotation, (os.PathLike, PurePath))):
        return PATH
    if origin is collections.abc.Callable or annotation is collections.abc.Callable:
        return CALLABLE
    bare, each_name = origin or annotation, name if name in OF_EACH else ""
    if isinstance(bare, type) and issubclass(bare, Mapping):
        return mapping(kind_of(arguments[1], each_name, names) if len(arguments) == 2 else ANYTHING)
    if bare is tuple and arguments and arguments[-1] is not Ellipsis:
        return row([kind_of(each, each_name, names) for each in arguments])
    if bare in (tuple, list, Sequence, Iterable, collections.abc.Collection):
        return several(kind_of(arguments[0], each_name, names) if arguments else ANYTHING, bare)
    return instance(bare) if isinstance(bare, type) and not _protocol(bare) else ANYTHING


def _protocol(kind: type) -> bool:
    return bool(getattr(kind, "_is_protocol", False))

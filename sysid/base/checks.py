"""Arguments of public calls, checked against their annotations before the work begins.

`checked` reads the annotations of a function or the fields of a dataclass. What a value may be is said by its type, and
for a number by its name in `sysid.base.limits`. An argument that a function judges itself, with a better sentence, is
named in `own`: it is looked at here only if the call ends in an error that is no sentence.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Container, Mapping
from typing import Any, TypeVar, overload

import numpy as np

from sysid.base.annotations import ARRAY, Kind, Wrong, is_number, kind_of, namespace
from sysid.base.errors import InputError
from sysid.base.limits import BY_NAME, Span

C = TypeVar("C", bound=Callable[..., Any])
_UNTYPED = (TypeError, ValueError, KeyError, IndexError, AttributeError, ArithmeticError, MemoryError, AssertionError)


@overload
def checked(what: C) -> C: ...


@overload
def checked(*, own: tuple[str, ...] = (), late: bool = False) -> Callable[[C], C]: ...


def checked(what: Any = None, *, own: tuple[str, ...] = (), late: bool = False) -> Any:
    """The function or the dataclass, which raises InputError for arguments that its annotations do not allow.

    Lists and tables of numbers are made arrays where the annotation is an array, and tuples where it is a tuple. With
    `late` every argument of a function is looked at only after an error, for a call that is made in every step of a
    search; a class with `late` says its own sentence first, and then what its annotations do not allow.
    """
    if what is None:
        return lambda found: _wrapped(found, own, late)
    return _wrapped(what, own, late)


def _wrapped(what: Any, own: tuple[str, ...], late: bool) -> Any:
    if isinstance(what, type):
        what.__init__ = _guarded(what.__init__, own, late, what)  # type: ignore[misc]
        return what
    return _guarded(what, own, late, None)


def _guarded(function: Callable[..., Any], own: tuple[str, ...], late: bool, owner: type | None) -> Callable[..., Any]:
    signature = inspect.signature(function)

    @functools.cache
    def kinds() -> dict[str, Kind]:
        """The kind of each argument, read at the first call: annotations may name what is imported later."""
        known = namespace(function, owner)
        return {p.name: kind_of(p.annotation, p.name, known) for p in signature.parameters.values()}

    def look(given: inspect.BoundArguments, names: Container[str] | None) -> None:
        """Every argument, or those of `names`, in its form."""
        for name, value in given.arguments.items():
            if names is None or name in names:
                given.arguments[name] = _made(kinds()[name], name, value, signature.parameters[name])

    early = tuple(name for name in signature.parameters if name not in own)
    sizes = {name: BY_NAME[name] for name in own if name in BY_NAME}

    @functools.wraps(function)
    def guarded(*args: Any, **kwargs: Any) -> Any:
        try:
            if late and owner is None:
                return function(*args, **kwargs)
            given = _bound(signature, args, kwargs)
            if given is None:
                return function(*args, **kwargs)
            try:
                look(given, early)
            except InputError:
                if late:
                    function(*args, **kwargs)
                raise
            for name in own:
                if is_number(given.arguments.get(name)):
                    given.arguments[name] = _plain(given.arguments[name])
            _check_sizes(sizes, given.arguments)
            return function(*given.args, **given.kwargs)
        except InputError:
            raise
        except _UNTYPED:
            given = _bound(signature, args, kwargs)
            if given is not None:
                look(given, None if late else own)
                _check_arrays(kinds(), given.arguments)
            raise

    return guarded


def check_fields(made: Any) -> None:
    """Raises InputError for a field of a dataclass that its annotation does not allow; it may stay as it is given."""
    whole: Any = type(made)
    for name, kind in _kinds_of_fields(whole).items():
        try:
            kind.made(getattr(made, name))
        except Wrong as wrong:
            where = f"{name} of a {type(made).__name__} {'is' if wrong.whole else 'has'}"
            raise InputError(f"{where} {shown(wrong.value)}; give {wrong.allowed}") from None


@functools.cache
def _kinds_of_fields(kind: Any) -> dict[str, Kind]:
    known = namespace(kind.__init__, kind)
    return {f.name: kind_of(f.type, f.name, known) for f in dataclasses.fields(kind) if f.init}


def _plain(value: Any) -> int | float:
    """A number as Python's own: NumPy's small integers wrap around, and a fraction cannot be formatted."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.item()
    return value if isinstance(value, (int, float)) else float(value)


def _check_sizes(sizes: Mapping[str, Span], given: Mapping[str, Any]) -> None:
    """Raises InputError for a number beyond its limit; all else about it the function says itself."""
    for name, span in sizes.items():
        value: Any = given.get(name)
        if is_number(value) and span.highest < value < np.inf:
            raise InputError(f"{name} is {shown(value)}; give {span.allowed(value, 'number')}")


def _check_arrays(kinds: Mapping[str, Kind], given: Mapping[str, Any]) -> None:
    """After an error: raises InputError for one number in place of an array, which many functions take too."""
    for name, value in given.items():
        if ARRAY.words in kinds[name].words and value is not None and np.ndim(value) == 0:
            raise InputError(f"{name} is {shown(value)}; give {ARRAY.words}")


def _bound(signature: inspect.Signature, args: Any, kwargs: Any) -> inspect.BoundArguments | None:
    """The arguments by name; None where Python itself says best which one is missing or unknown."""
    try:
        return signature.bind(*args, **kwargs)
    except TypeError:
        return None


def _made(kind: Kind, name: str, value: Any, parameter: inspect.Parameter) -> Any:
    """The value in the form that the function takes; raises InputError if there is none."""
    try:
        if parameter.kind is parameter.VAR_POSITIONAL:
            return tuple(kind.made(each) for each in value)
        if parameter.kind is parameter.VAR_KEYWORD:
            return {key: kind.made(each) for key, each in value.items()}
        return kind.made(value)
    except Wrong as wrong:
        where = f"{name} is" if wrong.whole else f"{name} has"
        raise InputError(f"{where} {shown(wrong.value)}; give {wrong.allowed}") from None


def array(name: str, value: Any) -> np.ndarray:
    """Real, finite numbers as an array of floats; raises InputError for anything else. `name` is the argument's."""
    try:
        return np.asarray(ARRAY.made(value), dtype=float)
    except Wrong as wrong:
        raise InputError(f"{name} is {shown(wrong.value)}; give {wrong.allowed}") from None


def shown(value: Any) -> str:
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

"""The text of a step with everything that it calls: one small module, stored with the block and read by `subset`."""

import dis
import hashlib
import inspect
import math
import textwrap
from collections.abc import Callable
from types import BuiltinFunctionType, FunctionType

import numpy as np

from sysid.base.errors import InputError
from sysid.block.compiler.ir import FUNCTIONS

_NAMED = (*FUNCTIONS, "ago")
_MAIN = ("step", "begin", "value")


def parts(functions: dict[str, Callable]) -> tuple[dict[str, FunctionType], dict[str, float]]:
    """All functions that these call, and all module-level numbers that they read, by name."""
    found: dict[str, FunctionType] = {}
    numbers: dict[str, float] = {}
    waiting = list(functions.items())
    while waiting:
        name, f = waiting.pop()
        if not isinstance(f, FunctionType):
            raise InputError(f"{name} is a {type(f).__name__}; give a plain function, written with def")
        found[name] = f
        for used in sorted({i.argval for i in dis.get_instructions(f) if i.opname == "LOAD_GLOBAL"}):
            value = f.__globals__.get(used)
            if used in _NAMED:
                _check_own(name, used, value)
            elif isinstance(value, FunctionType):
                if used in _MAIN and functions.get(used) is not value:
                    raise InputError(f"{name} calls a function {used}, a name kept for the block's own; rename it")
                if used in numbers or found.get(used, value) is not value:
                    raise _twice(used)
                if used not in found:
                    waiting.append((used, value))
            elif isinstance(value, (int, float)):
                if used in found or repr(numbers.get(used, value)) != repr(value):
                    raise _twice(used)
                numbers[used] = value
    if clash := {*found} & {*numbers}:
        raise _twice(min(clash))
    return found, numbers


def _check_own(name: str, used: str, value: object) -> None:
    """A function of the language must be the one that this name says."""
    own = getattr(value, "__module__", "") == "sysid.block.step" and isinstance(value, FunctionType)
    known = isinstance(value, (BuiltinFunctionType, np.ufunc)) and value.__name__ in (used, f"{used}olute")
    if not (value is None or own or known):
        raise InputError(f"{name} uses {used}, which is a name of the step's language; give yours another name")


def _twice(name: str) -> InputError:
    return InputError(f"{name} means different things in the modules of the step and its helpers; rename one of them")


def _written(name: str, value: float) -> str:
    """A number as a text that is read back as the same number."""
    if isinstance(value, float):
        if math.isnan(value):
            raise InputError(f"{name} is not a number (nan); give it a value")
        return repr(float(value)).replace("inf", "1e999")
    return repr(value)


def text(functions: dict[str, Callable]) -> str:
    """Source of a module that holds these functions, what they call and the numbers that they read.

    Raises InputError if Python cannot find a source (typed at a prompt); give the text itself then.
    """
    found, numbers = parts(functions)
    pieces = [f"{name} = {_written(name, value)}" for name, value in sorted(numbers.items())]
    for name, f in found.items():
        try:
            source = textwrap.dedent(inspect.getsource(f))
        except (OSError, TypeError):
            raise InputError(
                f"Python cannot find the source of {name}; give the text of the step instead of the function"
            ) from None
        if f.__name__ != name or not source.lstrip().startswith("def "):
            raise InputError(f"{name} is not a function written with def under this name; write it so")
        pieces.append(source.rstrip())
    return "\n\n\n".join(pieces) + "\n"


def fingerprint(functions: dict[str, Callable]) -> str:
    """Changes whenever `text` changes; made from the compiled functions, so that no source is read."""
    found, numbers = parts(functions)
    codes = [
        (name, f.__code__.co_code, repr(f.__code__.co_consts), f.__code__.co_names, f.__code__.co_varnames)
        for name, f in sorted(found.items())
    ]
    return hashlib.blake2b(repr((codes, sorted(numbers.items()))).encode(), digest_size=12).hexdigest()

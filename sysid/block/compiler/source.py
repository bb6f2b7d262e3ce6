"""The text of a step with everything that it calls: one small module, stored with the block and read by `subset`."""

import hashlib
import inspect
import textwrap
from collections.abc import Callable
from types import FunctionType

from sysid.base.errors import InputError
from sysid.block.compiler.ir import FUNCTIONS


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
        for used in f.__code__.co_names:
            value = f.__globals__.get(used)
            if used in (*FUNCTIONS, "ago"):
                continue
            if isinstance(value, FunctionType) and used not in found:
                waiting.append((used, value))
            elif isinstance(value, (int, float)):
                numbers[used] = value
    return found, numbers


def text(functions: dict[str, Callable]) -> str:
    """Source of a module that holds these functions, what they call and the numbers that they read.

    Raises InputError if Python cannot find a source (typed at a prompt); give the text itself then.
    """
    found, numbers = parts(functions)
    pieces = [f"{name} = {value!r}" for name, value in sorted(numbers.items())]
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

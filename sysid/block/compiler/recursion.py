"""Blocks written as one function, from which simulation, tangent and texts are derived.

The text of a step with everything that it calls is one small module, stored with the block and read by `subset`.
"""

import dis
import hashlib
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.kernel import kernels
from sysid.block.writing import CCode, Code, Writer

if TYPE_CHECKING:
    from sysid.block.compiler.ir import Program

_LANGUAGE_NAMES = (*FUNCTIONS, "ago")
_MAIN_NAMES = ("step", "begin", "value")


def step_parts(functions: dict[str, Callable]) -> tuple[dict[str, FunctionType], dict[str, float]]:
    """All functions that these call, and all module-level numbers that they read, by name."""
    parts: dict[str, FunctionType] = {}
    numbers: dict[str, float] = {}
    waiting = list(functions.items())
    while waiting:
        name, f = waiting.pop()
        if not isinstance(f, FunctionType):
            raise InputError(f"{name} is a {type(f).__name__}; give a plain function, written with def")
        parts[name] = f
        for used in sorted({i.argval for i in dis.get_instructions(f) if i.opname == "LOAD_GLOBAL"}):
            value = f.__globals__.get(used)
            if used in _LANGUAGE_NAMES:
                _check_language_name(name, used, value)
            elif isinstance(value, FunctionType):
                if used in _MAIN_NAMES and functions.get(used) is not value:
                    raise InputError(f"{name} calls a function {used}, a name kept for the block's own; rename it")
                if used in numbers or parts.get(used, value) is not value:
                    raise _ambiguous_name(used)
                if used not in parts:
                    waiting.append((used, value))
            elif isinstance(value, (int, float)):
                if used in parts or repr(numbers.get(used, value)) != repr(value):
                    raise _ambiguous_name(used)
                numbers[used] = value
    if clash := {*parts} & {*numbers}:
        raise _ambiguous_name(min(clash))
    return parts, numbers


def _check_language_name(name: str, used: str, value: object) -> None:
    """A function of the language must be the one that this name says."""
    is_ours = getattr(value, "__module__", "") == "sysid.block.step" and isinstance(value, FunctionType)
    is_builtin = isinstance(value, (BuiltinFunctionType, np.ufunc)) and value.__name__ in (used, f"{used}olute")
    if not (value is None or is_ours or is_builtin):
        raise InputError(f"{name} uses {used}, which is a name of the step's language; give yours another name")


def _ambiguous_name(name: str) -> InputError:
    return InputError(f"{name} means different things in the modules of the step and its helpers; rename one of them")


def _number_text(name: str, value: float) -> str:
    """A number as a text that is read back as the same number."""
    if isinstance(value, float):
        if math.isnan(value):
            raise InputError(f"{name} is not a number (nan); give it a value")
        return repr(float(value)).replace("inf", "1e999")
    return repr(value)


def step_text(functions: dict[str, Callable]) -> str:
    """Source of a module that holds these functions, what they call and the numbers that they read.

    Raises InputError if Python cannot find a source (typed at a prompt); give the text itself then.
    """
    parts, numbers = step_parts(functions)
    pieces = [f"{name} = {_number_text(name, value)}" for name, value in sorted(numbers.items())]
    for name, f in parts.items():
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
    parts, numbers = step_parts(functions)
    codes = [
        (name, f.__code__.co_code, repr(f.__code__.co_consts), f.__code__.co_names, f.__code__.co_varnames)
        for name, f in sorted(parts.items())
    ]
    return hashlib.blake2b(repr((codes, sorted(numbers.items()))).encode(), digest_size=12).hexdigest()


class Written(Block):
    """Common base of `Recursion` and `Map`: `functions` by name, read by `compiler.subset`, and all that is derived.

    Each may take the block as its last argument and read its structure. `absent` has the values of parameters that
    some structures do not have. `rare` are names of structure that most blocks lack: those without any have a kernel
    of their own, which compiles in 60 % of the time.
    """

    functions: ClassVar[Mapping[str, Callable]] = MappingProxyType({})
    absent: ClassVar[Mapping[str, float]] = MappingProxyType({})
    rare: ClassVar[tuple[str, ...]] = ()

    def c(self, theta: np.ndarray) -> CCode:
        from sysid.block.compiler.c_text import Affine, c

        program = self.program()
        (scalars, rows), *ahead = (self.numbers(each) for each in np.eye(len(theta) + 1, len(theta), -1))
        affine = Affine(
            {k: (v, _slopes([each[k] for each, _ in ahead], v)) for k, v in scalars.items()},
            {k: (v, _slopes([each[k] for _, each in ahead], v)) for k, v in rows.items()},
        )
        structure = {name: getattr(self, name) for name in program.consts}
        return c(program, affine, structure, self.slots(), theta)

    def python(self, theta: np.ndarray) -> Code:
        from sysid.block.compiler.python_text import python

        return python(*self._numbers(theta))

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        from sysid.block.compiler.equations import equations

        return equations(*self._numbers(theta), w, isinstance(self, StaticBlock))

    def program(self) -> "Program":
        """The functions as the compiler has read them."""
        return self._program

    @cached_property
    def _program(self) -> "Program":
        from sysid.block.compiler.subset import read

        return read(self._text(), "value" if "value" in self.functions else "step")

    def _program_without(self, off: Mapping[str, float]) -> "Program":
        from sysid.block.compiler.fold import without

        return without(self.program(), off) if off else self.program()

    def _text(self) -> str:
        return step_text(dict(self.functions))

    def _key(self) -> str:
        """Changes with the functions."""
        return fingerprint(dict(self.functions))

    def _folder(self) -> Path | None:
        """The folder beside which compiled kernels may lie."""
        return Path(inspect.getfile(type(self))).parent

    @cached_property
    def _kernels(self) -> tuple[Any, tuple]:
        """The kernels, and their arguments for this block's structure."""
        off = {name: getattr(self, name) for name in self.rare}
        off = {} if any(off.values()) else off  # two kernels, not one for each set of parts
        key = f"{self._key()} without {sorted(off)}" if off else self._key()
        module = kernels(type(self).__name__, key, lambda: self._program_without(off), self.absent, self._folder())
        names = [slot.name for slot in self.slots()]
        column = np.array([names.index(p) if p in names else -1 for p in module.PARAMETERS], dtype=np.int64)
        rows = {r: _row(names, r) for r in module.ROWS}
        idle = set(names) - set(module.PARAMETERS) - {name for row in rows.values() for name in row}
        if idle:
            raise InputError(f"no step or value reads a parameter {', '.join(sorted(idle))}; leave it out")
        ends = (end for row in rows.values() for end in (names.index(row[0]) if row else 0, len(row)))
        return module, (column, *(getattr(self, c) for c in module.STRUCTURE), *ends)

    def by_name(self, theta: np.ndarray) -> dict[str, float]:
        """theta (p,) by the names of the parameters."""
        return {slot.name: float(value) for slot, value in zip(self.slots(), theta, strict=True)}

    def numbers(self, theta: np.ndarray) -> tuple[dict[str, float], dict[str, np.ndarray]]:
        """Parameters of the functions by name, and their rows: by default those of the slots, always c + A theta."""
        values = self.by_name(theta)
        rows = {r: np.array([values[name] for name in _row(list(values), r)]) for r in self.program().rows}
        return {**self.absent, **values}, rows

    def _numbers(self, theta: np.ndarray) -> tuple["Program", dict[str, np.ndarray]]:
        """The program with theta and this structure inserted, and its rows of parameters."""
        from sysid.block.compiler.fold import specialise

        program, (values, rows) = self.program(), self.numbers(theta)
        structure = {name: getattr(self, name) for name in program.consts}
        return specialise(program, values, rows, structure), rows


class Recursion(Written):
    """A block with a memory.

    `functions` holds `step(s, x, p)` of states, input and parameters, which sets the states and returns the output,
    and `begin(s, x, p)`, which sets the initial states from the first input if they are not zero.
    """

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        y = np.empty_like(x)
        if not len(x):
            return y
        module, arguments = self._kernels
        if J.shape[1] and module.MEMORYLESS:
            from sysid.block.kernels import scale_columns

            slope = np.empty_like(x)
            module.tangent(theta, *arguments, x, y, slope, J, q)
            scale_columns(J, q, slope)
        elif J.shape[1]:
            module.tangent(theta, *arguments, x, y, J, q)
        else:
            module.value(theta, *arguments, x, y)
        return y


class Map(Written, StaticBlock):
    """A memoryless map; `functions` holds its `value(x, p)`."""

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        y = np.empty_like(x)
        if not len(x):
            return y, y
        module, arguments = self._kernels
        if not J.shape[1]:
            module.value(theta, *arguments, x, y)
            return y, y  # without tangents nobody asks for the slope
        slope = np.empty_like(x)
        module.tangent(theta, *arguments, x, y, slope, J, q)
        return y, slope


def _slopes(ahead: list[Any], base: Any) -> np.ndarray:
    """A (..., p) of c + A theta, from its values at the unit vectors and at zero."""
    if not ahead:
        return np.zeros((*np.shape(base), 0))
    with np.errstate(invalid="ignore"):
        return np.stack([np.where(each == base, 0.0, each - base) for each in ahead], axis=-1)


def _row(names: list[str], row: str) -> list[str]:
    """Names of the parameters of a row: its own with 0, 1, 2 ... or with 1, 2, 3 ... behind it."""
    k = 0 if f"{row}0" in names else 1
    numbers = []
    while f"{row}{k}" in names:
        numbers.append(f"{row}{k}")
        k += 1
    return numbers

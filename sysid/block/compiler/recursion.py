"""Blocks written as one function, from which simulation, tangent and texts are derived."""

import inspect
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.block.compiler import source
from sysid.block.compiler.kernel import kernels
from sysid.block.writing import Code, Writer

if TYPE_CHECKING:
    from sysid.block.compiler.ir import Program


class Written(Block):
    """Common base of `Recursion` and `Map`: `functions` by name, read by `compiler.subset`, and all that is derived.

    Each may take the block as its last argument and read its structure. `absent` has the values of parameters that
    some structures do not have.
    """

    functions: ClassVar[Mapping[str, Callable]] = MappingProxyType({})
    absent: ClassVar[Mapping[str, float]] = MappingProxyType({})

    def c(self, theta: np.ndarray) -> Code:
        from sysid.block.compiler.text_c import c

        return c(*self._numbers(theta))

    def python(self, theta: np.ndarray) -> Code:
        from sysid.block.compiler.text_python import python

        return python(*self._numbers(theta))

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        from sysid.block.compiler.equations import equations

        return equations(*self._numbers(theta), w, isinstance(self, StaticBlock))

    def program(self) -> "Program":
        """The functions as the compiler has read them."""
        from sysid.block.compiler.subset import read

        return read(self._text(), "value" if "value" in self.functions else "step")

    def _text(self) -> str:
        return source.text(dict(self.functions))

    def _key(self) -> str:
        """Changes with the functions."""
        return source.fingerprint(dict(self.functions))

    def _near(self) -> Path | None:
        """The folder beside which compiled kernels may lie."""
        return Path(inspect.getfile(type(self))).parent

    @cached_property
    def _compiled(self) -> tuple[Any, tuple]:
        """The kernels, and their arguments for this block's structure."""
        module = kernels(type(self).__name__, self._key(), self.program, self.absent, self._near())
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
        """Parameters of the functions by name, and their rows; by default those of the slots."""
        own = self.by_name(theta)
        rows = {r: np.array([own[name] for name in _row(list(own), r)]) for r in self.program().rows}
        return {**self.absent, **own}, rows

    def _numbers(self, theta: np.ndarray) -> tuple["Program", dict[str, np.ndarray]]:
        """The program with theta and this structure inserted, and its rows of parameters."""
        from sysid.block.compiler.fold import specialised

        program, (own, rows) = self.program(), self.numbers(theta)
        structure = {name: getattr(self, name) for name in program.consts}
        return specialised(program, own, rows, structure), rows


class Recursion(Written):
    """A block with a memory.

    `functions` holds `step(s, x, p)` of states, input and parameters, which sets the states and returns the output,
    and `begin(s, x, p)`, which sets the initial states from the first input if they are not zero.
    """

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        y = np.empty_like(x)
        if not len(x):
            return y
        module, arguments = self._compiled
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
        module, arguments = self._compiled
        if not J.shape[1]:
            module.value(theta, *arguments, x, y)
            return y, y  # without tangents nobody asks for the slope
        slope = np.empty_like(x)
        module.tangent(theta, *arguments, x, y, slope, J, q)
        return y, slope


def _row(names: list[str], row: str) -> list[str]:
    """Names of the parameters of a row: its own with 0, 1, 2 ... or with 1, 2, 3 ... behind it."""
    k = 0 if f"{row}0" in names else 1
    found = []
    while f"{row}{k}" in names:
        found.append(f"{row}{k}")
        k += 1
    return found

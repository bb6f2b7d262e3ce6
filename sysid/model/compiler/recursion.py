"""A block with a memory that is written as one step: its run, its tangent and its texts follow from there."""

import inspect
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from sysid.block import Block
from sysid.errors import InputError
from sysid.model.compiler import text
from sysid.model.compiler.equations import equations
from sysid.model.compiler.fold import specialised
from sysid.model.compiler.ir import Program
from sysid.model.compiler.kernel import kernels
from sysid.model.compiler import source
from sysid.model.writing import Code, Writer
from sysid.model.compiler.subset import read


class Recursion(Block):
    """Subclasses give `recursion`: a function `step(s, x, p)` of states, input and parameters that returns the output,
    and `begin(s, x, p)`, which sets the states from the first input, where they do not begin at zero.

    Both may take the block as a fourth argument and read its structure. A parameter that some structures do without
    stands in `absent` with the value that it then has. What a step may be made of, see `compiler.subset`.
    """

    recursion: ClassVar[Mapping[str, Callable]] = MappingProxyType({})
    absent: ClassVar[Mapping[str, float]] = MappingProxyType({})

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        y = np.empty_like(x)
        if not len(x):
            return y
        module, arguments = self._compiled
        if J.shape[1]:
            module.tangent(theta, *arguments, x, y, J, q)
        else:
            module.value(theta, *arguments, x, y)
        return y

    @cached_property
    def _compiled(self) -> tuple[Any, tuple]:
        """The kernels, and what tells them this block's structure."""
        module = self._kernels()
        names = [slot.name for slot in self.slots()]
        column = np.array([names.index(p) if p in names else -1 for p in module.PARAMETERS], dtype=np.int64)
        rows = [(names.index(f"{r}0"), _length(names, r)) for r in module.ROWS]
        idle = set(names) - set(module.PARAMETERS) - {f"{r}{k}" for r, (_, n) in zip(module.ROWS, rows, strict=True) for k in range(n)}
        if idle:
            raise InputError(f"the step reads no parameter called {', '.join(sorted(idle))}; leave it out")
        structure = (getattr(self, c) for c in module.STRUCTURE)
        return module, (column, *structure, *(v for row in rows for v in row))

    def _kernels(self) -> Any:
        """The module of compiled kernels."""
        near = Path(inspect.getfile(type(self))).parent
        return kernels(type(self).__name__, source.fingerprint(dict(self.recursion)), self.program, self.absent, near)

    def c(self, theta: np.ndarray) -> Code:
        """C99 of the run with these numbers."""
        return text.c(*self._numbers(theta))

    def python(self, theta: np.ndarray) -> Code:
        """Python of the run with these numbers."""
        return text.python(*self._numbers(theta))

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The recursion as equations; a block whose motion has a better known form gives that instead."""
        return equations(*self._numbers(theta), w)

    def _numbers(self, theta: np.ndarray) -> tuple[Program, dict[str, np.ndarray]]:
        """The program with theta and this structure put in, and its rows of parameters."""
        program = self.program()
        names = [slot.name for slot in self.slots()]
        own = dict(zip(names, theta.tolist(), strict=True))
        rows = {r: np.array([own[f"{r}{k}"] for k in range(_length(names, r))]) for r in program.rows}
        structure = {name: getattr(self, name) for name in program.consts}
        return specialised(program, {**self.absent, **own}, rows, structure), rows

    def program(self) -> Program:
        """The recursion as the compiler has read it."""
        return read(source.text(dict(self.recursion)))


def _length(names: list[str], row: str) -> int:
    k = 0
    while f"{row}{k}" in names:
        k += 1
    return k

"""A program with its numbers as the body of a C99 and of a Python function."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.ir import (
    Assign,
    Body,
    For,
    If,
    Op,
    Program,
    Return,
    Stmt,
    Var,
)
from sysid.block.compiler.text import Text, indent
from sysid.block.writing import Code


def python(program: Program, rows: Mapping[str, np.ndarray]) -> Code:
    """Body of a Python function of x, which needs math."""
    return _Python(program, rows).code()


class _Python(Text):
    words: ClassVar = {"and": "and", "or": "or", "not": "not "}

    def choice(self, test: str, a: str, b: str) -> str:
        return f"{a} if {test} else {b}"

    def call(self, e: Op) -> str:
        integer = e.op in ("min", "max", "abs") and self.integer(e)
        args = [self.show(a, 0, integer) for a in e.args]
        return FUNCTIONS[e.op].python.format(", ".join(args))

    def operation(self, e: Op) -> tuple[str, int]:
        if e.op == "**":
            return f"{self.show(e.args[0], 9)} ** {self.show(e.args[1], 8)}", 8
        return super().operation(e)

    def lines(self) -> list[str]:
        lines = []
        if self.kept > self.flag:
            lines += [f"if not s[{self.flag}]:  # the first sample", *indent(self._first())]
        names = [self.name(Var(n, True)) for n in self.program.states]
        if names:
            values = "s" if len(names) == self.kept else f"s[:{len(names)}]"
            lines.append(f"{', '.join(names)} = {values}" if len(names) > 1 else f"{names[0]} = s[0]")
        return lines + self.body(self.program.step)

    def _first(self) -> list[str]:
        self.direct = True
        lines = self.body(self.program.begin) if self.waits else []
        self.direct = False
        past = [f"s[{self.flag + 1}:] = [x] * {self.oldest}"] if self.oldest > 1 else []
        past += [f"s[{self.flag + 1}] = x"] if self.oldest == 1 else []
        return [*lines, *past, f"s[{self.flag}] = 1.0"]

    def body(self, body: Body) -> list[str]:
        return [line for s in body for line in self.statement(s)]

    def statement(self, s: Stmt) -> list[str]:
        if isinstance(s, Assign):
            return [f"{self.name(s.target)} = {self.show(s.value, 0, s.target in self.whole)}"]
        if isinstance(s, If):
            lines = [f"if {self.show(s.test)}:", *indent(self.body(s.body))]
            while len(s.orelse) == 1 and isinstance(s.orelse[0], If):
                s = s.orelse[0]
                lines += [f"elif {self.show(s.test)}:", *indent(self.body(s.body))]
            return [*lines, *(["else:", *indent(self.body(s.orelse))] if s.orelse else [])]
        if isinstance(s, For):
            return [
                f"for {self.name(Var(s.index))} in range({self.show(s.count, 0, True)}):",
                *indent(self.body(s.body)),
            ]
        if isinstance(s, Return):
            value, before = self.show(s.value), []
            if self._past(s.value):  # before the past moves on
                value, before = "out", [f"out = {value}"]
            return [*before, *self.end(), f"return {value}"]
        return ["break"]

    def end(self) -> list[str]:
        names = [n for n in self.program.states if n in self.moved]
        lines = [f"s[{self.program.states.index(n)}] = {self.name(Var(n, True))}" for n in names]
        if self.oldest:
            lines.append(
                f"s[{self.flag + 1}:] = [x] + s[{self.flag + 1}:-1]" if self.oldest > 1 else f"s[{self.flag + 1}] = x"
            )
        return lines

"""A program with its numbers as the body of a C99 and of a Python function."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.ir import (
    COMPARISONS,
    Ago,
    Assign,
    Body,
    For,
    If,
    Op,
    Program,
    Return,
    Stmt,
    Var,
    expressions,
    statements,
)
from sysid.block.compiler.text import Text, home, indent, locals_of, uses, variables_in
from sysid.block.writing import Code


def c(program: Program, rows: Mapping[str, np.ndarray]) -> Code:
    """Body of a C99 function of x."""
    return _C(program, rows).code()


class _C(Text):
    words: ClassVar = {"and": "&&", "or": "||", "not": "!"}

    def choice(self, test: str, a: str, b: str) -> str:
        return f"{test} ? {a} : {b}"

    def call(self, e: Op) -> str:
        integer = e.op in ("min", "max", "abs") and self.integer(e)
        args = [self.show(a, 0, integer) for a in e.args]
        if integer and e.op in ("min", "max"):
            return f"({args[1]} {'<' if e.op == 'min' else '>'} {args[0]} ? {args[1]} : {args[0]})"
        return ("pow({})" if e.op == "**" else FUNCTIONS[e.op].c).format(", ".join(args))

    def operation(self, e: Op) -> tuple[str, int]:
        if e.op == "**":
            return self.call(e), 10
        if e.op == "/" and all(self.integer(a) for a in e.args):
            return f"(double)({self.show(e.args[0], 0, True)}) / {self.show(e.args[1], 7, True)}", 6
        return super().operation(e)

    def lines(self) -> list[str]:
        used = any(isinstance(e, Ago) for e in expressions(self.program.step)) or self.oldest or self.waits
        lines = [] if used else ["(void)x;"]
        if self.kept > self.flag:
            lines += [f"if (s[{self.flag}] == 0.0) {{ /* the first sample */", *indent(self._first()), "}"]
        for name in self.program.states:
            const = "" if name in self.moved else "const "
            lines.append(f"{const}double {self.name(Var(name, True))} = s[{self.program.states.index(name)}];")
        return lines + self.body(self.program.step, locals_of(self.program.step))

    def _first(self) -> list[str]:
        self.direct = True
        lines = self.body(self.program.begin, locals_of(self.program.begin)) if self.waits else []
        self.direct = False
        if self.oldest:
            first, last = self.flag + 1, self.flag + self.oldest
            loop = f"for (int i = {first}; i <= {last}; ++i) " if last > first else ""
            lines.append(f"{loop}s[{'i' if loop else first}] = x;")
        return [*lines, f"s[{self.flag}] = 1.0;"]

    def body(self, body: Body, variables: set[Var]) -> list[str]:
        """Statements, each variable declared in the innermost braces that hold all of its uses."""
        scope = {v for v in variables if home(body, v) is None}
        open_, lines = set(scope), []
        for s in body:
            for v in sorted(open_ & uses(s), key=lambda v: v.name):
                if not (isinstance(s, Assign) and s.target == v):
                    lines.append(f"{self.kind(v)} {self.name(v)} = 0;")
                    open_.discard(v)
            lines += self.statement(s, open_, {v for v in variables - scope if v in uses(s)}, body)
            open_ -= uses(s)
        return lines

    def kind(self, v: Var) -> str:
        if v not in self.whole:
            return "double"
        both = (self.program.begin, self.program.step)
        values = [s.value for b in both for s in statements(b) if isinstance(s, Assign) and s.target == v]
        truths = all(isinstance(e, Op) and e.op in ("and", "or", "not", *COMPARISONS) for e in values)
        return "int" if truths else "long long"  # whole numbers as wide as in the compiled run

    def statement(self, s: Stmt, fresh: set[Var], inner: set[Var], around: Body) -> list[str]:
        if isinstance(s, Assign):
            first = ""
            if s.target in fresh:
                count = sum(1 for e in statements(around) if isinstance(e, Assign) and e.target == s.target)
                first = f"{'const ' if count == 1 else ''}{self.kind(s.target)} "
            return [f"{first}{self.name(s.target)} = {self.show(s.value, 0, s.target in self.whole)};"]
        if isinstance(s, If):
            return self._if(s, inner)
        if isinstance(s, For):
            i = self.name(Var(s.index))
            head = f"for (int {i} = 0; {i} < {self.show(s.count, 5, True)}; ++{i}) {{"
            return [head, *indent(self.body(s.body, inner)), "}"]
        if isinstance(s, Return):
            value, before = self.show(s.value), []
            if self._past(s.value):  # before the past moves on
                value, before = "out", [f"const double out = {value};"]
            return [*before, *self.end(), f"return {value};"]
        return ["break;"]

    def _if(self, s: If, inner: set[Var]) -> list[str]:
        lines = [f"if ({self.show(s.test)}) {{", *indent(self.body(s.body, inner & variables_in(s.body)))]
        if self._chained(s, inner):
            (more,) = s.orelse
            assert isinstance(more, If)
            first, *others = self._if(more, inner)
            return [*lines, f"}} else {first}", *others]
        if s.orelse:
            lines += ["} else {", *indent(self.body(s.orelse, inner & variables_in(s.orelse)))]
        return [*lines, "}"]

    def _chained(self, s: If, inner: set[Var]) -> bool:
        """Whether all that stands behind else is one more if, without a variable of its own to declare before it."""
        if len(s.orelse) != 1 or not isinstance(s.orelse[0], If):
            return False
        return all(home(s.orelse, v) is not None for v in inner & variables_in(s.orelse))

    def end(self) -> list[str]:
        names = [n for n in self.program.states if n in self.moved]
        lines = [f"s[{self.program.states.index(n)}] = {self.name(Var(n, True))};" for n in names]
        first, last = self.flag + 1, self.flag + self.oldest
        if self.oldest > 1:
            lines.append(f"for (int i = {last}; i > {first}; --i) s[i] = s[i - 1];")
        return [*lines, *([f"s[{first}] = x;"] if self.oldest else [])]


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

"""A program with numbers as readable equations: one equation if possible, else the step line by line."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from sysid.block.compiler.ir import (
    Ago,
    Assign,
    Body,
    Expr,
    For,
    If,
    Num,
    Op,
    Param,
    Program,
    Return,
    Var,
    expressions,
    rebuilt,
)
from sysid.block.compiler.text import Text
from sysid.block.writing import Writer


def equations(program: Program, rows: Mapping[str, np.ndarray], w: Writer, timeless: bool) -> list[str]:
    """Lines in t (the sample number), without t for a map; states other than the output have names."""
    printer = _Lines(program, rows)
    printer.w, printer.shift, printer.timeless = w, 0, timeless
    one = _recursion(program)
    if one is not None:
        value, printer.shift, state = one
        printer.own = state
        return [f"{w.y}{'' if printer.timeless else '(t)'} = {printer.show(value)}"]
    printer.own = None
    states = f", states {', '.join(program.states)}" if program.states else ""
    lines = [f"{w.y}(t), sample by sample{states}:", *(f"  {line}" for line in printer.body(program.step))]
    tables = [f"  {r} = {', '.join(w.num(v) for v in rows[r])}" for r in program.rows if printer.reads(r)]
    return [*lines, *tables]


def _recursion(program: Program) -> tuple[Expr, int, str] | None:
    """The output as one expression, its delay in samples, and the state that holds the previous output."""
    definitions: dict[Var, Expr] = {}
    for s in program.step:
        if isinstance(s, Assign):
            definitions[s.target] = _put(s.value, definitions)
        elif isinstance(s, Return):
            value = _put(s.value, definitions)
            states = [Var(n, True) for n in program.states]
            if not states:
                return value, 0, ""
            if len(states) > 1 or any(isinstance(e, Ago) for e in expressions(program.step) if e != Ago(Num(0))):
                return None
            new = definitions.get(states[0], states[0])
            if value == new:
                return value, 0, states[0].name
            return (new, 1, states[0].name) if value == states[0] else None
        else:
            return None
    return None


def _put(e: Expr, known: Mapping[Var, Expr]) -> Expr:
    return known.get(e, e) if isinstance(e, Var) else rebuilt(e, lambda a: _put(a, known))


class _Lines(Text):
    """Formulas with ^, in names and t."""

    words: ClassVar = {"and": "and", "or": "or", "not": "not "}
    w: Writer
    shift: int
    own: str | None
    timeless: bool = False

    def reads(self, row: str) -> bool:
        return self._reads(row)

    def name(self, v: Var) -> str:
        return f"{self.w.y}(t-1)" if v.state and v.name == self.own else v.name

    def plain(self, value: float, whole: bool) -> str:
        return str(int(value)) if whole else self.w.num(value)

    def ago(self, n: Expr) -> str:
        if isinstance(n, Num):
            k = int(n.value) + self.shift
            if self.timeless:
                return self.w.x
            return f"{self.w.x}(t-{k})" if k else f"{self.w.x}(t)"
        return f"{self.w.x}(t-({self.show(n, 0, True)}))"

    def choice(self, test: str, a: str, b: str) -> str:
        return f"{a} if {test} else {b}"

    def call(self, e: Op) -> str:
        return f"{e.op}({', '.join(self.show(a, 0, self.integer(a)) for a in e.args)})"

    def operation(self, e: Op) -> tuple[str, int]:
        if e.op == "**":
            return f"{self.show(e.args[0], 9)}^{self.show(e.args[1], 8)}", 8
        if e.op == "sign":
            return self.call(e), 10
        text, rank = super().operation(e)
        return (text.replace(" * ", "*").replace(" / ", "/"), rank) if e.op in ("*", "/") else (text, rank)

    def show(self, e: Expr, rank: int = 0, whole: bool = False) -> str:
        if isinstance(e, Param) and e.index is not None:
            return f"{e.name}[{self.show(e.index, 0, True)}]"
        return super().show(e, rank, whole)

    def body(self, body: Body) -> list[str]:
        lines: list[str] = []
        for s in body:
            if isinstance(s, Assign):
                lines.append(f"{self.name(s.target)} = {self.show(s.value, 0, s.target in self.whole)}")
            elif isinstance(s, Return):
                lines.append(f"{self.w.y}(t) = {self.show(s.value)}")
            elif isinstance(s, If):
                lines += [f"if {self.show(s.test)}:", *(f"  {line}" for line in self.body(s.body))]
                lines += ["else:", *(f"  {line}" for line in self.body(s.orelse))] if s.orelse else []
            elif isinstance(s, For):
                times = f"{self.show(s.count, 0, True)} times, {s.index} from 0"
                lines += [f"{times}:", *(f"  {line}" for line in self.body(s.body))]
            else:
                lines.append("leave these repetitions")
        return lines

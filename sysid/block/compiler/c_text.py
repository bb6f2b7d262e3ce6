"""A program as the body of a C99 function whose parameters stay variable."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from sysid.block.block import Slot
from sysid.block.compiler.fold import specialise
from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.ir import (
    COMPARISONS,
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
    Stmt,
    Var,
    expressions,
    map_expressions,
    rebuilt,
    statements,
    walk,
)
from sysid.block.compiler.text import Text, home, indent, locals_of, uses, variables_in, word
from sysid.block.compiler.through import feeds
from sysid.block.writing import CCode, number

_ROOM = 2.0  # memory of a delay reaches so many times as far back as the fit has it, and at least
_LEAST_ROOM = 4.0  # so many samples
_TRUTHS = ("and", "or", "not", *COMPARISONS)


@dataclass(frozen=True)
class Affine:
    """Numbers of a program as they hang on theta (p,): `scalars` and `rows` are c + A theta, as (c, A)."""

    scalars: Mapping[str, tuple[float, np.ndarray]]
    rows: Mapping[str, tuple[np.ndarray, np.ndarray]]


def c(program: Program, affine: Affine, structure: Mapping[str, float], slots: tuple[Slot, ...], theta: np.ndarray):
    """The program as `CCode`: the fields of its parameters are the slots, its other numbers are written in."""
    fixed = {name: float(c) for name, (c, A) in affine.scalars.items() if not A.any()}
    constant = {name: c for name, (c, A) in affine.rows.items() if not A.any()}
    lengths = {name: np.empty(len(c)) for name, (c, _) in affine.rows.items()}
    folded = specialise(program, fixed, constant, structure)
    limits = _limits(folded, slots, theta, structure.get("Ts", 1.0))
    clamped = {slots[k].name: (Num(slots[k].lower), Num(limit)) for k, limit in limits.items()}
    if clamped:
        folded = replace(folded, step=map_expressions(folded.step, lambda e: _within(e, clamped)))
    printer = _C(folded, lengths)
    printer.numbers, printer.slots = affine, slots
    return printer.c_code(limits)


def _within(e: Expr, clamped: Mapping[str, tuple[Num, Num]]) -> Expr:
    if isinstance(e, Param) and e.name in clamped and e.index is None:
        low, high = clamped[e.name]
        return Op("min", (Op("max", (e, low)), high))
    return rebuilt(e, lambda a: _within(a, clamped))


def _limits(program: Program, slots: tuple[Slot, ...], theta: np.ndarray, Ts: float) -> dict[int, float]:
    """How far the parameters may go on which a look back hangs, by position; in seconds with samples of Ts [s]."""
    waiting = [e.n for e in expressions(program.step) if isinstance(e, Ago)]
    names: set[str] = set()
    done: set[Var] = set()
    while waiting:
        for e in walk(waiting.pop()):
            if isinstance(e, Param):
                names.add(e.name)
            elif isinstance(e, Var) and e not in done:
                done.add(e)
                waiting += [s.value for s in statements(program.step) if isinstance(s, Assign) and s.target == e]
    limits = {}
    for k, slot in enumerate(slots):
        if slot.name in names:
            unit = Ts if slot.unit == "s" else 1.0
            limits[k] = min(slot.upper, unit * max(_LEAST_ROOM, math.ceil(_ROOM * theta[k] / unit)))
    return limits


def _divided(e: Expr, by: float) -> Expr:
    """The limits of a parameter by that of a sample."""
    if isinstance(e, Num):
        return Num(e.value / by)
    return Op(e.op, tuple(_divided(a, by) for a in e.args)) if isinstance(e, Op) and e.op in ("min", "max") else e


class _C(Text):
    words: ClassVar = {"and": "&&", "or": "||", "not": "!"}
    numbers: Affine
    slots: tuple[Slot, ...]
    places: dict[int, str]  # how a parameter is read
    tables: dict[str, np.ndarray]

    def c_code(self, limits: dict[int, float]) -> CCode:
        """The whole body, with states, parameters and tables."""
        taken = {self.name(Var(n, True)) for n in self.program.states}
        self.begun, self.past = word("begun", taken), word("past", taken)
        self.fields = _fields(self.slots, self.numbers)
        self.places, self.tables = {}, {}
        for field, at in self.fields.items():
            each = [at] if isinstance(at, int) else at
            self.places |= {k: f"p->{field}" if isinstance(at, int) else f"p->{field}[{i}]" for i, k in enumerate(each)}
        states = {self.name(Var(n, True)): 0 for n in self.program.states}
        states |= {self.begun: 0} if self.kept > self.flag else {}
        states |= {self.past: self.oldest} if self.oldest else {}
        self.direct = True
        begin = [] if self.waits else self.body(self.program.begin, locals_of(self.program.begin))
        self.direct = False
        body = self.lines()
        local = [line for row in self.program.rows for line in self._copy(row)]
        return CCode(
            "\n".join([*local, *body]), states, self.fields, "\n".join(begin), self.tables,
            feeds=feeds(self.program.step, self._span), limits=limits,
        )  # fmt: skip

    # Parameters

    def show(self, e: Expr, rank: int = 0, whole: bool = False) -> str:
        if isinstance(e, Param):
            return self._param(e)
        loose = isinstance(e, Var) or (isinstance(e, Op) and e.op not in _TRUTHS)
        if loose and not whole and self.integer(e) and e not in self.truths:
            return f"(double){super().show(e, 10, True)}"
        return super().show(e, rank, whole)

    def _param(self, e: Param) -> str:
        if e.index is None:
            constant, A = self.numbers.scalars[e.name]
            return self._sum(constant, A)
        constants, M = self.numbers.rows[e.name]
        assert e.index is not None
        index = self.show(e.index, 0, True)
        if self.inside(e) is not e.index:
            index = f"place_of({index}, {len(M)})"
        if not M.any():
            self.tables[self.table(e.name)] = constants
            return f"{self.table(e.name)}[{index}]"
        if (field := self._pure(e.name)) is not None:
            return f"p->{field}[{index}]"
        if self._sparse(e.name):
            return f"{self.table(e.name)}[{index}]"
        width = len(self._weights(e.name)[0])
        return f"sum_of(&{self.table(e.name)}[{width} * {index}], theta, {width})"

    def _sum(self, constant: float, A: np.ndarray) -> str:
        """c + A theta: a parameter, or a sum in brackets."""
        terms = [(float(A[k]), self.places[int(k)]) for k in np.flatnonzero(A)]
        if constant == 0.0 and len(terms) == 1 and terms[0][0] == 1.0:
            return terms[0][1]
        text = number(constant) if constant or not terms else ""
        for weight, place in sorted(terms, reverse=True):
            factor = place if abs(weight) == 1.0 else f"{number(abs(weight))} * {place}"
            sign = ("-" if weight < 0 else "") if not text else (" - " if weight < 0 else " + ")
            text += sign + factor
        return f"({text})"

    def _pure(self, row: str) -> str | None:
        """The field whose values are the row's."""
        constants, M = self.numbers.rows[row]
        eye = np.eye(len(self.slots))
        for field, at in self.fields.items():
            if not isinstance(at, int) and not constants.any() and np.array_equal(M, eye[list(at)]):
                return field
        return None

    def _sparse(self, row: str) -> bool:
        """Whether each of the row's values is a number or a parameter."""
        constants, M = self.numbers.rows[row]
        return bool(np.all(np.count_nonzero(np.column_stack([constants, M]), axis=1) <= 1))

    def _copy(self, row: str) -> list[str]:
        """A local table of a row that is no field, where it is read."""
        constants, M = self.numbers.rows[row]
        if not self._reads(row) or not M.any() or self._pure(row) is not None:
            return []
        if self._sparse(row):
            values = ", ".join(self._sum(float(a), A) for a, A in zip(constants, M, strict=True))
            return [f"const double {self.table(row)}[{len(M)}] = {{{values}}};"]
        names, weights = self._weights(row)
        self.tables[self.table(row)] = weights.ravel()
        return [f"const double theta[{len(names)}] = {{{', '.join(names)}}};"]

    def _weights(self, row: str) -> tuple[list[str], np.ndarray]:
        """What a row is a sum of, and the weights (row, names) of it."""
        wide = np.column_stack(self.numbers.rows[row])
        used = np.flatnonzero(wide.any(axis=0))
        return ["1.0" if k == 0 else self.places[int(k) - 1] for k in used], wide[:, used]

    # Expressions

    def name(self, v: Var) -> str:
        return f"s->{self.named[v]}" if v.state and self.direct else self.named[v]

    def choice(self, test: str, a: str, b: str) -> str:
        return f"{test} ? {a} : {b}"

    def call(self, e: Op) -> str:
        integer = e.op in ("min", "max", "abs") and self.integer(e)
        args = [self.show(a, 0, integer) for a in e.args]
        if integer and e.op in ("min", "max"):
            return f"({args[1]} {'<' if e.op == 'min' else '>'} {args[0]} ? {args[1]} : {args[0]})"
        return ("pow({})" if e.op == "**" else FUNCTIONS[e.op].c).format(", ".join(args))

    def operation(self, e: Op) -> tuple[str, int]:
        return (self.call(e), 10) if e.op == "**" else super().operation(e)

    def ago(self, n: Expr) -> str:
        low, high = self._span(n)
        if high == 0:
            return "x"
        where = str(int(n.value) - 1) if isinstance(n, Num) else self.show(Op("-", (n, Num(1))), 0, True)
        value = f"s->{self.past}[{where}]"
        return value if low > 0 else f"({self.choice(f'{self.show(n, 5, True)} > 0', value, 'x')})"

    def _span(self, n: Expr) -> tuple[int, int]:
        if isinstance(n, Var) and n.name not in self.spans:
            values = [s.value for s in statements(self.program.step) if isinstance(s, Assign) and s.target == n]
            if len(values) == 1:
                return self._span(values[0])
        if (isinstance(n, Op) and n.op in ("floor", "int")) or isinstance(n, Num):
            value = n if isinstance(n, Num) else n.args[0]
            return self._span(value) if not isinstance(value, Num) else (math.floor(value.value),) * 2
        if isinstance(n, Op) and n.op in ("min", "max") and isinstance(n.args[1], Num):
            end = n.args[1].value
            if n.op == "min":
                return self._span(n.args[0])[0], math.ceil(end)
            return math.floor(end), math.floor(end)
        if isinstance(n, Op) and n.op == "/" and isinstance(n.args[1], Num):  # a time by that of a sample
            return self._span(_divided(n.args[0], n.args[1].value))
        return super()._span(n)

    # Statements

    def lines(self) -> list[str]:
        used = any(isinstance(e, Ago) for e in expressions(self.program.step)) or self.oldest or self.waits
        lines = [] if used else ["(void)x;"]
        if self.kept > self.flag:
            lines += [f"if (s->{self.begun} == 0.0) {{ /* the first sample */", *indent(self._first()), "}"]
        for name in self.program.states:
            const = "" if name in self.moved else "const "
            lines.append(f"{const}double {self.name(Var(name, True))} = s->{self.name(Var(name, True))};")
        return lines + self.body(self.program.step, locals_of(self.program.step))

    def _first(self) -> list[str]:
        self.direct = True
        lines = self.body(self.program.begin, locals_of(self.program.begin)) if self.waits else []
        self.direct = False
        if self.oldest:
            lines.append(f"for (int i = 0; i < {self.oldest}; ++i) s->{self.past}[i] = x;")
        return [*lines, f"s->{self.begun} = 1.0;"]

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
        return "double" if v not in self.whole else "int" if v in self.truths else "long"

    @cached_property
    def truths(self) -> set[Var]:
        """Variables that hold only true or false."""
        both = (*statements(self.program.begin), *statements(self.program.step))
        found = set(self.whole)
        while True:
            others = {s.target for s in both if isinstance(s, Assign) and not _is_truth(s.value, found)} & found
            if not others:
                return found
            found -= others

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
        names = [self.name(Var(n, True)) for n in self.program.states if n in self.moved]
        lines = [f"s->{name} = {name};" for name in names]
        if self.oldest > 1:
            lines.append(f"for (int i = {self.oldest - 1}; i > 0; --i) s->{self.past}[i] = s->{self.past}[i - 1];")
        return [*lines, *([f"s->{self.past}[0] = x;"] if self.oldest else [])]


def _is_truth(e: Expr, known: set[Var]) -> bool:
    if isinstance(e, Num):
        return isinstance(e.value, bool)
    return e in known if isinstance(e, Var) else isinstance(e, Op) and e.op in _TRUTHS


def _fields(slots: tuple[Slot, ...], numbers: Affine) -> dict[str, int | tuple[int, ...]]:
    """The slots as fields of a struct: those of a row together, as an array."""
    in_rows = {int(k) for _, M in numbers.rows.values() for k in np.flatnonzero(M.any(axis=0))}
    fields: dict[str, int | tuple[int, ...]] = {}
    for k, slot in enumerate(slots):
        if k in in_rows:
            name = word(re.sub(r"\d+$", "", slot.name))
            fields[name] = (*fields.get(name, ()), k)  # type: ignore[misc]
        else:
            fields[word(slot.name)] = k
    return fields

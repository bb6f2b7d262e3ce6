"""A program with its numbers as the body of an exported function, in C99 and in Python."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.errors import InputError
from sysid.model.compiler.ir import (
    COMPARISONS,
    Ago,
    Assign,
    Body,
    Break,
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
    own,
    statements,
    walk,
)
from sysid.model.writing import Code, number

_RANK = {"if": 0, "or": 1, "and": 2, "not": 3, **dict.fromkeys(COMPARISONS, 4), "+": 5, "-": 5, "*": 6, "/": 6}
_RANK |= {"neg": 7, "**": 8}
_TAKEN = {  # names that a local variable may not have in either language
    *("auto break case char const continue default do double else enum extern float for goto if inline int long").split(),
    *("register restrict return short signed sizeof static struct switch typedef union unsigned void volatile").split(),
    *("while and as assert class def del elif except finally from global import in is lambda nonlocal not or").split(),
    *("pass raise try with yield None True False s x math exp log sqrt tanh sin cos floor fabs fmin fmax pow").split(),
    *("abs min max range main y0 y1 yn j0 j1 jn").split(),
}


def c(program: Program, rows: Mapping[str, np.ndarray]) -> Code:
    """Body of a C99 function."""
    return _C(program, rows).code()


def python(program: Program, rows: Mapping[str, np.ndarray]) -> Code:
    """Body of a Python function."""
    return _Python(program, rows).code()


@dataclass
class _Text:
    """What both languages share: expressions, what is kept from sample to sample, and how a body begins and ends."""

    program: Program
    rows: Mapping[str, np.ndarray]
    words: ClassVar[Mapping[str, str]] = {}

    def __post_init__(self) -> None:
        step = self.program.step
        self.spans = {s.index: s.count for s in statements(step) if isinstance(s, For)}
        self.whole = _whole(step) | _whole(self.program.begin)
        self.oldest = max((self._span(e.n)[1] for e in expressions(step) if isinstance(e, Ago)), default=0)
        self.waits = any(isinstance(e, Ago) for e in expressions(self.program.begin))  # for the first input
        self.flag = len(self.program.states)
        self.kept = self.flag + (1 + self.oldest if self.oldest or self.waits else 0)
        self.direct = False  # whether states are written where they are kept
        self.moved = {s.target.name for s in statements(step) if isinstance(s, Assign) and s.target.state}

    def code(self) -> Code:
        """The whole body, with its tables and what its states begin with."""
        tables = {r.upper(): np.asarray(self.rows[r]) for r in self.program.rows if self._reads(r)}
        return Code("\n".join(self.lines()), self.kept, tables, self._start())

    def _reads(self, row: str) -> bool:
        return any(isinstance(e, Param) and e.name == row for e in expressions(self.program.step))

    def _start(self) -> dict[str, float]:
        start = dict.fromkeys(self.program.states, 0.0)
        if not self.waits:
            for s in statements(self.program.begin):
                if not isinstance(s, Assign) or not isinstance(s.value, Num):
                    raise InputError("what a state begins with has no value without a run of begin; write it plainly")
                start[s.target.name] = float(s.value.value)
        return start

    def _span(self, n: Expr) -> tuple[int, int]:
        """Smallest and largest value of how far the program looks back."""
        if isinstance(n, Num):
            return int(n.value), int(n.value)
        if isinstance(n, Var) and isinstance(self.spans.get(n.name), Num):
            return 0, int(self.spans[n.name].value) - 1  # type: ignore[union-attr]
        if isinstance(n, Op) and n.op in ("+", "-"):
            (a, b), (c, d) = (self._span(v) for v in n.args)
            return (a + c, b + d) if n.op == "+" else (a - d, b - c)
        if isinstance(n, Op) and n.op == "int":
            return self._span(n.args[0])
        raise InputError("how far a step looks back changes as it runs, so it cannot be written out; make it a number")

    # Expressions

    def name(self, v: Var) -> str:
        if v.state and self.direct:
            return f"s[{self.program.states.index(v.name)}]"
        others = self.program.states if not v.state else ()
        name = v.name
        while name in _TAKEN or name in others or name.upper() in {r.upper() for r in self.rows if name.isupper()}:
            name += "_"
        return name

    def show(self, e: Expr, rank: int = 0, whole: bool = False) -> str:
        """An expression, in brackets where it binds less than `rank`; `whole` asks for a whole number."""
        if isinstance(e, Num):
            text = self.plain(e.value, whole)
            return f"({text})" if text.startswith("-") and rank > 0 else text
        if isinstance(e, Var):
            return self.name(e)
        if isinstance(e, Param):
            return f"{e.name.upper()}[{self.show(e.index, 0, True)}]" if e.index is not None else e.name
        if isinstance(e, Ago):
            return self.ago(e.n)
        assert isinstance(e, Op)
        text, own_rank = self.operation(e)
        return f"({text})" if own_rank < rank else text

    def plain(self, value: float, whole: bool) -> str:
        return str(int(value)) if whole else number(value)

    def operation(self, e: Op) -> tuple[str, int]:
        """Text of an operation and how tightly it binds (10: not at all loose)."""
        rank = _RANK.get(e.op, 10)
        if e.op in ("+", "-", "*", "/") or e.op in COMPARISONS:
            whole = e.op != "/" and all(self.integer(a) for a in e.args)
            up = 1 if e.op in COMPARISONS else 0
            left, right = self.show(e.args[0], rank + up, whole), self.show(e.args[1], rank + 1, whole)
            return f"{left} {e.op} {right}", rank
        if e.op in ("and", "or"):
            sides = [self.show(a, 10 if isinstance(a, Op) and {a.op, e.op} == {"and", "or"} else rank) for a in e.args]
            return f" {self.words[e.op]} ".join(sides), rank
        if e.op == "not":
            return f"{self.words['not']}{self.show(e.args[0], 10)}", rank
        if e.op == "neg":
            return f"-{self.show(e.args[0], 8, self.integer(e))}", rank
        if e.op == "sign":
            a = self.show(e.args[0], 5)
            nested = self.choice(f"{a} < 0.0", number(-1.0), number(0.0))
            return self.choice(f"{a} > 0.0", number(1.0), f"({nested})"), 0
        if e.op == "if":
            whole = self.integer(e)
            a, b = (self.show(v, 1, whole) for v in e.args[1:])
            return self.choice(self.show(e.args[0], 1), a, b), 0
        return self.call(e), 10


    def integer(self, e: Expr) -> bool:
        """Whether an expression is a whole number by its kind."""
        return _is_whole(e, self.whole | {Var(i) for i in self.spans})

    def choice(self, test: str, a: str, b: str) -> str:
        raise NotImplementedError

    def call(self, e: Op) -> str:
        raise NotImplementedError

    def ago(self, n: Expr) -> str:
        low, high = self._span(n)
        if high == 0:
            return "x"
        if isinstance(n, Num):
            return f"s[{self.flag + int(n.value)}]"
        where = self.show(Op("+", (Num(self.flag), n)), 0, True)
        if low > 0:
            return f"s[{where}]"
        return f"({self.choice(f'{self.show(n, 5, True)} > 0', f's[{where}]', 'x')})"

    def lines(self) -> list[str]:
        raise NotImplementedError


class _C(_Text):
    words = {"and": "&&", "or": "||", "not": "!"}

    def choice(self, test: str, a: str, b: str) -> str:
        return f"{test} ? {a} : {b}"

    def call(self, e: Op) -> str:
        whole = e.op in ("min", "max", "abs") and self.integer(e)
        args = [self.show(a, 0, whole) for a in e.args]
        if whole and e.op in ("min", "max"):
            return f"({args[1]} {'<' if e.op == 'min' else '>'} {args[0]} ? {args[1]} : {args[0]})"
        if e.op == "int":
            return f"(int)({args[0]})"
        names = {"min": "fmin", "max": "fmax", "abs": "fabs", "**": "pow"}
        return f"{names.get(e.op, e.op)}({', '.join(args)})"

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
            lines += [f"if (s[{self.flag}] == 0.0) {{ /* the first sample */", *_in(self._first()), "}"]
        for name in self.program.states:
            const = "" if name in self.moved else "const "
            lines.append(f"{const}double {self.name(Var(name, True))} = s[{self.program.states.index(name)}];")
        return lines + self.body(self.program.step, _locals(self.program.step))

    def _first(self) -> list[str]:
        self.direct = True
        lines = self.body(self.program.begin, _locals(self.program.begin)) if self.waits else []
        self.direct = False
        if self.oldest:
            first, last = self.flag + 1, self.flag + self.oldest
            lines.append(f"for (int i = {first}; i <= {last}; ++i) s[i] = x;")
        return [*lines, f"s[{self.flag}] = 1.0;"]

    def body(self, body: Body, variables: set[Var]) -> list[str]:
        """Statements, each variable declared in the innermost braces that hold all of its uses."""
        here = {v for v in variables if _home(body, v) is None}
        open_, lines = set(here), []
        for s in body:
            for v in sorted(open_ & _uses(s), key=lambda v: v.name):
                if not (isinstance(s, Assign) and s.target == v):
                    lines.append(f"{self.kind(v)} {self.name(v)} = 0;")
                    open_.discard(v)
            lines += self.statement(s, open_, {v for v in variables - here if v in _uses(s)}, body)
            open_ -= _uses(s)
        return lines

    def kind(self, v: Var) -> str:
        return "int" if v in self.whole else "double"

    def statement(self, s: Stmt, fresh: set[Var], inner: set[Var], around: Body) -> list[str]:
        if isinstance(s, Assign):
            first = ""
            if s.target in fresh:
                count = sum(1 for e in statements(around) if isinstance(e, Assign) and e.target == s.target)
                first = f"{'const ' if count == 1 else ''}{self.kind(s.target)} "
            return [f"{first}{self.name(s.target)} = {self.show(s.value, 0, s.target in self.whole)};"]
        if isinstance(s, If):
            lines = [f"if ({self.show(s.test)}) {{", *_in(self.body(s.body, inner & _used(s.body)))]
            while self._chained(s, inner):
                s = s.orelse[0]  # type: ignore[assignment]
                lines += [f"}} else if ({self.show(s.test)}) {{", *_in(self.body(s.body, inner & _used(s.body)))]
            if s.orelse:
                lines += ["} else {", *_in(self.body(s.orelse, inner & _used(s.orelse)))]
            return [*lines, "}"]
        if isinstance(s, For):
            i = self.name(Var(s.index))
            head = f"for (int {i} = 0; {i} < {self.show(s.count, 5, True)}; ++{i}) {{"
            return [head, *_in(self.body(s.body, inner)), "}"]
        if isinstance(s, Return):
            return [*self.end(), f"return {self.show(s.value)};"]
        return ["break;"]

    def _chained(self, s: If, inner: set[Var]) -> bool:
        """Whether all that stands behind else is one more if, without a variable of its own to declare before it."""
        if len(s.orelse) != 1 or not isinstance(s.orelse[0], If):
            return False
        return all(_home(s.orelse, v) is not None for v in inner & _used(s.orelse))

    def end(self) -> list[str]:
        names = [n for n in self.program.states if n in self.moved]
        lines = [f"s[{self.program.states.index(n)}] = {self.name(Var(n, True))};" for n in names]
        first, last = self.flag + 1, self.flag + self.oldest
        if self.oldest > 1:
            lines.append(f"for (int i = {last}; i > {first}; --i) s[i] = s[i - 1];")
        return [*lines, *([f"s[{first}] = x;"] if self.oldest else [])]


class _Python(_Text):
    words = {"and": "and", "or": "or", "not": "not "}

    def choice(self, test: str, a: str, b: str) -> str:
        return f"{a} if {test} else {b}"

    def call(self, e: Op) -> str:
        whole = e.op in ("min", "max", "abs") and self.integer(e)
        args = [self.show(a, 0, whole) for a in e.args]
        name = e.op if e.op in ("abs", "min", "max", "int") else f"math.{e.op}"
        return f"{name}({', '.join(args)})"

    def operation(self, e: Op) -> tuple[str, int]:
        if e.op == "**":
            return f"{self.show(e.args[0], 9)} ** {self.show(e.args[1], 8)}", 8
        return super().operation(e)

    def lines(self) -> list[str]:
        lines = []
        if self.kept > self.flag:
            lines += [f"if not s[{self.flag}]:  # the first sample", *_in(self._first())]
        names = [self.name(Var(n, True)) for n in self.program.states]
        if names:
            values = "s" if len(names) == self.kept else f"s[:{len(names)}]"
            lines.append(f"{', '.join(names)} = {values}" if len(names) > 1 else f"{names[0]} = s[0]")
        return lines + self.body(self.program.step)

    def _first(self) -> list[str]:
        self.direct = True
        lines = self.body(self.program.begin) if self.waits else []
        self.direct = False
        past = [f"s[{self.flag + 1}:] = [x] * {self.oldest}"] if self.oldest else []
        return [*lines, *past, f"s[{self.flag}] = 1.0"]

    def body(self, body: Body) -> list[str]:
        return [line for s in body for line in self.statement(s)]

    def statement(self, s: Stmt) -> list[str]:
        if isinstance(s, Assign):
            return [f"{self.name(s.target)} = {self.show(s.value, 0, s.target in self.whole)}"]
        if isinstance(s, If):
            lines = [f"if {self.show(s.test)}:", *_in(self.body(s.body))]
            while len(s.orelse) == 1 and isinstance(s.orelse[0], If):
                s = s.orelse[0]
                lines += [f"elif {self.show(s.test)}:", *_in(self.body(s.body))]
            return [*lines, *(["else:", *_in(self.body(s.orelse))] if s.orelse else [])]
        if isinstance(s, For):
            return [f"for {self.name(Var(s.index))} in range({self.show(s.count, 0, True)}):", *_in(self.body(s.body))]
        if isinstance(s, Return):
            return [*self.end(), f"return {self.show(s.value)}"]
        return ["break"]

    def end(self) -> list[str]:
        names = [n for n in self.program.states if n in self.moved]
        lines = [f"s[{self.program.states.index(n)}] = {self.name(Var(n, True))}" for n in names]
        if self.oldest:
            lines.append(f"s[{self.flag + 1}:] = [x] + s[{self.flag + 1}:-1]" if self.oldest > 1 else f"s[{self.flag + 1}] = x")
        return lines


def _in(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _locals(body: Body) -> set[Var]:
    return {s.target for s in statements(body) if isinstance(s, Assign) and not s.target.state}


def _uses(s: Stmt) -> set[Var]:
    """Variables that a statement reads or sets, nested ones included."""
    found = {v for each in statements((s,)) for e in own(each) for v in walk(e) if isinstance(v, Var)}
    return found | {each.target for each in statements((s,)) if isinstance(each, Assign)}


def _used(body: Body) -> set[Var]:
    return {v for s in body for v in _uses(s)}


def _home(body: Body, v: Var) -> Body | None:
    """The one body within these statements that holds all uses of v; None where this is the innermost one."""
    holders = [s for s in body if v in _uses(s)]
    if len(holders) != 1 or isinstance(holders[0], (Assign, Return)):
        return None
    s = holders[0]
    if any(v in walk(e) for e in own(s)):
        return None
    inner = [b for b in ((s.body, s.orelse) if isinstance(s, If) else (s.body,) if isinstance(s, For) else ()) if v in _used(b)]
    return inner[0] if len(inner) == 1 else None


def _is_whole(e: Expr, known: set[Var]) -> bool:
    if isinstance(e, Num):
        return not isinstance(e.value, float)
    if isinstance(e, Var):
        return e in known
    if not isinstance(e, Op):
        return False
    if e.op in ("and", "or", "not", "int", *COMPARISONS):
        return True
    if e.op in ("+", "-", "*", "min", "max", "neg", "abs", "if"):
        return all(_is_whole(a, known) for a in (e.args[1:] if e.op == "if" else e.args))
    return False


def _whole(body: Body) -> set[Var]:
    """Local variables that only ever hold whole numbers."""
    indices = {Var(s.index) for s in statements(body) if isinstance(s, For)}
    known = _locals(body)
    while True:
        less = {s.target for s in statements(body) if isinstance(s, Assign) and not _is_whole(s.value, known | indices)}
        if not known & less:
            return known
        known -= less

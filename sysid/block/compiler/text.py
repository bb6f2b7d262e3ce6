"""A program with numbers as the body of an exported function: the common part of C99 and Python."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from keyword import kwlist
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.block.compiler.functions import EXPORTED, FUNCTIONS
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
    expressions_of,
    statements,
    walk,
)
from sysid.block.writing import Code, number

_RANK = {"if": 0, "or": 1, "and": 2, "not": 3, **dict.fromkeys(COMPARISONS, 4), "+": 5, "-": 5, "*": 6, "/": 6}
_RANK |= {"neg": 7, "**": 8}
_KEYWORDS = """auto bitand bitor bool case catch char compl const constexpr default delete do double enum explicit
export extern false float friend goto inline int long mutable namespace new nullptr operator private protected public
register restrict short signed sizeof static struct switch template this throw true typedef typeid typename union
unsigned using virtual void volatile wchar_t xor and_eq not_eq or_eq xor_eq"""
_C_WORDS = {*_KEYWORDS.split(), *kwlist}
_C_NAMES = {"pow", "main", "y0", "y1", "yn", "j0", "j1", "jn", "min_of", "max_of", "sum_of", "place_of"}
_TAKEN = EXPORTED | _C_WORDS | _C_NAMES | {"math", "range", "s", "p", "x", "out", "theta"}  # names for no variable


def word(name: str, taken: Collection[str] = ()) -> str:
    """The name of a field, with _ behind it where it has a meaning in C, C++ or Python or is taken."""
    while name in _C_WORDS or name in taken:
        name += "_"
    return name


@dataclass
class Text:
    """The common part of both languages: expressions, stored states, and the start and end of a body."""

    program: Program
    rows: Mapping[str, np.ndarray]
    words: ClassVar[Mapping[str, str]] = {}

    def __post_init__(self) -> None:
        step = self.program.step
        self.spans = {s.index: s.count for s in statements(step) if isinstance(s, For)}
        self.whole = wholes(step) | wholes(self.program.begin)
        self.oldest = max((self._span(e.n)[1] for e in expressions(step) if isinstance(e, Ago)), default=0)
        self.waits = any(isinstance(e, Ago) for e in expressions(self.program.begin))  # for the first input
        self.flag = len(self.program.states)
        self.kept = self.flag + (1 + self.oldest if self.oldest or self.waits else 0)
        self.named = self._names()
        self.direct = False  # whether states are written where they are kept
        self.moved = {s.target.name for s in statements(step) if isinstance(s, Assign) and s.target.state}

    def _names(self) -> dict[Var, str]:
        """A name for every state and variable, its own where that is free."""
        states = [Var(s, True) for s in self.program.states]
        bodies = (self.program.begin, self.program.step)
        locals_ = {Var(s.index) for b in bodies for s in statements(b) if isinstance(s, For)}
        locals_ |= {v for b in bodies for s in statements(b) for v in uses(s) if not v.state}
        every = [*states, *sorted(locals_, key=lambda v: v.name)]
        wanted, reserved, names = {v.name for v in every}, {*_TAKEN, *(self.table(r) for r in self.rows)}, {}
        for v in every:
            name = v.name
            while name in reserved or (name != v.name and name in wanted):
                name += "_"
            names[v] = name
            reserved.add(name)
        return names

    def table(self, row: str) -> str:
        """The name of a row's table: in capitals, unless another row has these."""
        return (
            row if row.upper() != row and any(r != row and r.upper() == row.upper() for r in self.rows) else row.upper()
        )

    def code(self) -> Code:
        """The whole body, with its tables and initial states."""
        tables = {self.table(r): np.asarray(self.rows[r]) for r in self.program.rows if self._reads(r)}
        return Code("\n".join(self.lines()), self.kept, tables, self._start())

    def _reads(self, row: str) -> bool:
        return any(isinstance(e, Param) and e.name == row for e in expressions(self.program.step))

    def _past(self, e: Expr) -> bool:
        return any(isinstance(each, Ago) and each.n != Num(0) for each in walk(e))

    def _start(self) -> dict[str, float]:
        start = dict.fromkeys(self.program.states, 0.0)
        if not self.waits:
            for s in statements(self.program.begin):
                if not isinstance(s, Assign) or not isinstance(s.value, Num):
                    raise InputError(
                        "the initial value of a state cannot be computed without running begin; "
                        "write it as a plain expression"
                    )
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
        raise InputError("the input lag of the step is not constant, so it cannot be exported; make it a number")

    # Expressions

    def name(self, v: Var) -> str:
        if v.state and self.direct:
            return f"s[{self.program.states.index(v.name)}]"
        return self.named[v]

    def show(self, e: Expr, rank: int = 0, whole: bool = False) -> str:
        """An expression, in brackets where it binds less than `rank`; `whole` asks for a whole number."""
        if isinstance(e, Num):
            text = self.plain(e.value, whole)
            return f"({text})" if text.startswith("-") and rank > 0 else text
        if isinstance(e, Var):
            return self.name(e)
        if isinstance(e, Param):
            return e.name if e.index is None else f"{self.table(e.name)}[{self.show(self.inside(e), 0, True)}]"
        if isinstance(e, Ago):
            return self.ago(e.n)
        assert isinstance(e, Op)
        text, own_rank = self.operation(e)
        return f"({text})" if own_rank < rank else text

    def inside(self, e: Param) -> Expr:
        """The index of a row, kept within it as in the compiled run."""
        assert e.index is not None
        last, span = len(self.rows[e.name]) - 1, self.spans.get(e.index.name) if isinstance(e.index, Var) else None
        if isinstance(e.index, Num) or (isinstance(span, Num) and span.value <= last + 1):
            return e.index
        return Op("min", (Op("max", (e.index, Num(0))), Num(last)))

    def plain(self, value: float, whole: bool) -> str:
        return str(int(value)) if whole else number(value)

    def operation(self, e: Op) -> tuple[str, int]:
        """Text of an operation and how tightly it binds (10: not at all loose)."""
        rank = _RANK.get(e.op, 10)
        if e.op in ("+", "-", "*", "/") or e.op in COMPARISONS:
            integer = e.op != "/" and all(self.integer(a) for a in e.args)
            up = 1 if e.op in COMPARISONS else 0
            left, right = self.show(e.args[0], rank + up, integer), self.show(e.args[1], rank + 1, integer)
            return f"{left} {e.op} {right}", rank
        if e.op in ("and", "or"):
            sides = [self.show(a, 10 if isinstance(a, Op) and {a.op, e.op} == {"and", "or"} else rank) for a in e.args]
            return f" {self.words[e.op]} ".join(sides), rank
        if e.op == "not":
            return f"{self.words['not']}{self.show(e.args[0], 10)}", rank
        if e.op == "neg":
            return f"-{self.show(e.args[0], 8, self.integer(e))}", rank
        if e.op == "if":
            integer = self.integer(e)
            a, b = (self.show(v, 1, integer) for v in e.args[1:])
            return self.choice(self.show(e.args[0], 1), a, b), 0
        spelt = FUNCTIONS[e.op].spelt if e.op in FUNCTIONS else None
        return (self.call(e), 10) if spelt is None else self.operation(spelt(*e.args))

    def integer(self, e: Expr) -> bool:
        """Whether an expression is a whole number by its kind."""
        return is_whole(e, self.whole | {Var(i) for i in self.spans})

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


def indent(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def locals_of(body: Body) -> set[Var]:
    return {s.target for s in statements(body) if isinstance(s, Assign) and not s.target.state}


def uses(s: Stmt) -> set[Var]:
    """Variables that a statement reads or sets, nested ones included."""
    variables = {v for each in statements((s,)) for e in expressions_of(each) for v in walk(e) if isinstance(v, Var)}
    return variables | {each.target for each in statements((s,)) if isinstance(each, Assign)}


def variables_in(body: Body) -> set[Var]:
    return {v for s in body for v in uses(s)}


def home(body: Body, v: Var) -> Body | None:
    """The one body within these statements that holds all uses of v; None where this is the innermost one."""
    holders = [s for s in body if v in uses(s)]
    if len(holders) != 1 or isinstance(holders[0], (Assign, Return)):
        return None
    s = holders[0]
    if any(v in walk(e) for e in expressions_of(s)):
        return None
    inner = [
        b
        for b in ((s.body, s.orelse) if isinstance(s, If) else (s.body,) if isinstance(s, For) else ())
        if v in variables_in(b)
    ]
    return inner[0] if len(inner) == 1 else None


def is_whole(e: Expr, known: set[Var]) -> bool:
    if isinstance(e, Num):
        return not isinstance(e.value, float)
    if isinstance(e, Var):
        return e in known
    if not isinstance(e, Op):
        return False
    if e.op in ("and", "or", "not", "int", *COMPARISONS):
        return True
    if e.op in ("+", "-", "*", "min", "max", "neg", "abs", "if"):
        return all(is_whole(a, known) for a in (e.args[1:] if e.op == "if" else e.args))
    return False


def wholes(body: Body) -> set[Var]:
    """Local variables that only ever hold whole numbers."""
    indices = {Var(s.index) for s in statements(body) if isinstance(s, For)}
    integers = locals_of(body)
    while True:
        less = {
            s.target for s in statements(body) if isinstance(s, Assign) and not is_whole(s.value, integers | indices)
        }
        if not integers & less:
            return integers
        integers -= less

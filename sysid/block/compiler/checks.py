"""Checks of a step that need all of it: whole numbers, lags, truth values, growth in loops, and depth."""

from sysid.base.errors import InputError
from sysid.block.compiler.ir import (
    COMPARISONS,
    Ago,
    Assign,
    Body,
    Const,
    Expr,
    For,
    If,
    Num,
    Op,
    Param,
    Program,
    Var,
    children,
    expressions,
    expressions_of,
    statements,
    walk,
)
from sysid.block.compiler.phrases import constant, leaves, variables
from sysid.block.compiler.text import is_whole, locals_of, wholes

LONGEST = 2000  # statements, helpers put in
_DEEPEST = 80  # brackets in brackets, and statements in statements: what Python reads of the kernel's text


class Facts:
    """What the variables of a program may hold."""

    def __init__(self, body: Body) -> None:
        self.assigned = [s for s in statements(body) if isinstance(s, Assign)]
        self.loops = [s for s in statements(body) if isinstance(s, For)]
        self.spans = {Var(s.index): constant(s.count) for s in self.loops}
        self.whole = wholes(body) | set(self.spans)
        self.truths = self._largest_subset(locals_of(body), lambda e, known: is_truth(e, known))
        self.still = self._largest_subset(locals_of(body), lambda e, known: _still(e, known | set(self.spans)))

    def _largest_subset(self, known: set[Var], holds) -> set[Var]:
        while True:
            less = {s.target for s in self.assigned if s.target in known and not holds(s.value, known)}
            if not less:
                return known
            known = known - less

    def against(self, use: str, e: Expr) -> str:
        """What is wrong with this use of an expression; empty if nothing is."""
        if use == "truth":
            right = is_truth(e, self.truths)
            return "" if right else "and, or give true or false here, not one of their values; write a if test else b"
        n = constant(e)
        if n is not None and (not isinstance(n, int) or n < 0):
            what = "lag of ago" if use == "lag" else "index of a row"
            return f"the {what} is {n}; give a whole number from 0"
        if not is_whole(_with_structure(e), self.whole):
            what = "lag of ago" if use == "lag" else "index of a row"
            return f"the {what} is not a whole number; write int(...)"
        if use == "lag" and not _still(e, self.still | set(self.spans)):
            return "the lag of ago may not depend on states or the input"
        if use == "lag" and self._lowest(e) < 0:
            return "the lag of ago becomes negative; give a whole number from 0"
        if use == "index" and self._lowest(e) < 0:
            return "the index of a row becomes negative; give a whole number from 0"
        return ""

    def _lowest(self, e: Expr) -> float:
        """A number that the expression does not fall below, as far as loops alone set it; 0 where unknown."""
        low = _range(e, self.spans)
        return 0 if low is None else low[0]

    def growing(self) -> list[Assign]:
        """Assignments in loops that multiply, or add, whole numbers carried from pass to pass."""
        growth = []
        for loop in self.loops:
            assignments = [s for s in statements(loop.body) if isinstance(s, Assign) and s.target in self.whole]
            carried = {
                s.target for s in assignments if s.target in {o.target for o in self.assigned if o not in assignments}
            }
            while more := {s.target for s in assignments if variables(s.value) & carried} - carried:
                carried |= more
            growth += [s for s in assignments if s.target in carried and _grows(s.value, carried)]
        return growth


def is_truth(e: Expr, known: set[Var]) -> bool:
    """Whether an expression is true or false by its kind."""
    if isinstance(e, Num):
        return isinstance(e.value, bool)
    if isinstance(e, (Var, Const)):
        return isinstance(e, Const) or e in known
    if not isinstance(e, Op):
        return False
    if e.op in ("and", "or"):
        return all(is_truth(a, known) for a in e.args)
    return e.op == "not" or e.op in COMPARISONS or (e.op == "if" and all(is_truth(a, known) for a in e.args[1:]))


def whole_count(e: Expr) -> bool:
    """Whether a number of passes is a whole number by its kind."""
    return is_whole(_with_structure(e), set())


def _with_structure(e: Expr) -> Expr:
    """The same with whole numbers for values of the block's structure, which are checked elsewhere."""
    if isinstance(e, Const):
        return Num(1)
    return Op(e.op, tuple(_with_structure(a) for a in e.args)) if isinstance(e, Op) and e.op != "int" else e


def _still(e: Expr, known: set[Var]) -> bool:
    """Whether neither states nor the input move an expression."""
    return all(not isinstance(v, Ago) and (not isinstance(v, Var) or v in known) for v in walk(e))


def _range(e: Expr, spans: dict[Var, float | None]) -> tuple[float, float] | None:
    if (n := constant(e)) is not None:
        return n, n
    if isinstance(e, Var) and (count := spans.get(e)) is not None:
        return 0, count - 1
    if isinstance(e, Op) and e.op in ("+", "-", "*"):
        a, b = (_range(v, spans) for v in e.args)
        if a and b and e.op == "*":
            ends = [p * q for p in a for q in b]
            return min(ends), max(ends)
        if a and b:
            return (a[0] + b[0], a[1] + b[1]) if e.op == "+" else (a[0] - b[1], a[1] - b[0])
    return None


def _grows(e: Expr, carried: set[Var]) -> bool:
    if sum(v in carried for v in leaves(e)) > 1:
        return True
    return any(isinstance(o, Op) and o.op == "*" and variables(o) & carried for o in walk(e))


def check_depth(program: Program) -> None:
    """Raises InputError if the compiled text would nest deeper than Python reads."""
    for body in (program.begin, program.step):
        if _levels(body) > _DEEPEST:
            raise InputError(f"statements of the step stand in more than {_DEEPEST} others; use fewer branches")
        for s in statements(body):
            if any(_depth(e) > _DEEPEST for e in expressions_of(s)):
                raise InputError(
                    f"an expression of the step nests more than {_DEEPEST} levels deep; split it over several lines"
                )


def _depth(e: Expr) -> int:
    return 1 + max((_depth(a) for a in children(e)), default=0)


def _levels(body: Body) -> int:
    inner = [
        b for s in body for b in ((s.body, s.orelse) if isinstance(s, If) else (s.body,) if isinstance(s, For) else ())
    ]
    return 1 + max((_levels(b) for b in inner), default=0)


def check_rows(program: Program, lengths: dict[str, int]) -> None:
    """Raises InputError if a constant index is beyond its row."""
    for e in (*expressions(program.begin), *expressions(program.step)):
        n = constant(e.index) if isinstance(e, Param) and e.index is not None else None
        if n is not None and isinstance(e, Param) and n >= lengths[e.name]:
            raise InputError(
                f"the step reads p.{e.name}[{n}], and the row {e.name} has {lengths[e.name]} number(s); "
                f"the index is at most {lengths[e.name] - 1}"
            )

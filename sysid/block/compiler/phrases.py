"""Reads expressions of a step into `ir`, and reports what is not allowed; see `subset`."""

import ast
import math
from dataclasses import dataclass, field
from typing import NoReturn

from sysid.base.errors import InputError
from sysid.block.compiler.fold import evaluate
from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.ir import Ago, Assign, Const, Expr, Num, Op, Param, Stmt, Var, statements, walk

ARITHMETIC = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_ALLOWED = (
    "a step may use numbers, + - * / **, comparisons, and, or, not, if, for _ in range(n), break, return, "
    f"{', '.join(FUNCTIONS)}, ago(x, n), and small functions of its own module written in the same way"
)
Row = str  # the name of a row of parameters, handed to a helper whole
DEEPEST = 20  # calls within calls
LARGEST = 2**31 - 1  # of whole numbers
HINT = "1e10"


@dataclass
class Frame:
    """One function being read: the meaning of its names, and the targets of its results (None: it is the step)."""

    name: str
    source: str
    first: int
    kinds: dict[str, str]  # state, params, block, by the name of the argument
    values: dict[str, "Expr | Row"]  # arguments that are put in as they are
    input: str | None
    results: tuple[Var, ...] | None = None
    locals: dict[str, str] = field(default_factory=dict)
    depth: int = 0
    looping: int = 0
    indices: tuple[str, ...] = ()  # of the loops around


class Phrases:
    """Expressions of the functions in a module text."""

    text: str
    functions: dict[str, ast.FunctionDef]
    numbers: dict[str, float]
    states: dict[str, None]
    taken: set[str]
    beginning: bool
    uses: list[tuple[Frame, ast.AST, str, Expr]]  # indices, lags and truth values, checked when all is read

    def _call(self, f: Frame, node: ast.Call, results: tuple[Var, ...], out: list[Stmt]) -> None:
        raise NotImplementedError

    def _expr(self, f: Frame, node: ast.expr, out: list[Stmt]) -> Expr:
        if isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
            return self._number(f, node, node.value)
        if isinstance(node, ast.Name):
            return self._name(f, node)
        if isinstance(node, ast.Attribute):
            return self._attribute(f, node)
        if isinstance(node, ast.Subscript):
            return self._element(f, node, out)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd, ast.Not)):
            if isinstance(node.op, ast.Not):
                return Op("not", (self._test(f, node.operand, out),))
            inner = self._expr(f, node.operand, out)
            return inner if isinstance(node.op, ast.UAdd) else Op("neg", (inner,))
        if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
            left, right = self._expr(f, node.left, out), self._expr(f, node.right, out)
            if isinstance(node.op, ast.Pow) and right == Num(2) and not isinstance(left, Op):
                return Op("*", (left, left))
            return self._check_length(f, node, Op(ARITHMETIC[type(node.op)], (left, right)))
        if isinstance(node, ast.BoolOp):
            found = self._test(f, node, out)
            self.uses.append((f, node, "truth", found))
            return found
        if isinstance(node, ast.Compare) and all(type(op) in _COMPARE for op in node.ops):
            sides = [self._expr(f, v, out) for v in (node.left, *node.comparators)]
            pairs = zip(node.ops, sides, sides[1:], strict=False)
            return fold_constants("and", [Op(_COMPARE[type(op)], (a, b)) for op, a, b in pairs])
        if isinstance(node, ast.IfExp):
            test = self._test(f, node.test, out)
            return Op("if", (test, *(self._expr(f, v, out) for v in (node.body, node.orelse))))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return self._function_of(f, node, out)
        self._refuse(f, node)

    def _test(self, f: Frame, node: ast.expr, out: list[Stmt]) -> Expr:
        """An expression of which only the truth counts."""
        if not isinstance(node, ast.BoolOp):
            return self._expr(f, node, out)
        values = [self._test(f, v, out) for v in node.values]
        return fold_constants("and" if isinstance(node.op, ast.And) else "or", values)

    def _number(self, f: Frame, node: ast.expr, value: float) -> Num:
        if isinstance(value, int) and abs(value) > LARGEST:
            self._refuse(f, node, f"whole numbers are at most 2**31 - 1; write a larger one with a point ({HINT})")
        return Num(value)

    def _check_length(self, f: Frame, node: ast.expr, e: Op) -> Expr:
        """The operation; one on whole constants must give a number of the allowed size."""
        v = [constant(a) for a in e.args]
        if (e.op == "/" and v[1] == 0) or (e.op == "**" and v[0] == 0 and v[1] is not None and v[1] < 0):
            self._refuse(f, node, "this divides by zero; give another number")
        if v[0] is None or v[1] is None:
            return e
        try:
            size = {"+": v[0] + v[1], "-": v[0] - v[1], "*": v[0] * v[1]}.get(e.op)
            size = float(v[0]) ** float(v[1]) if e.op == "**" else size
        except OverflowError:
            size = math.inf
        except ZeroDivisionError:
            size = None
        if isinstance(size, complex) or (isinstance(size, float) and e.op == "**" and abs(size) > 1e300):
            self._refuse(f, node, "this power is too large or is not a real number; give a smaller one")
        if isinstance(size, int):
            self._number(f, node, size)
        return e

    def _function_of(self, f: Frame, node: ast.Call, out: list[Stmt], whole: bool = False) -> Expr:
        """The value of a call; `whole`: the statement holds nothing else."""
        name = node.func.id  # type: ignore[attr-defined]
        if name in f.locals or name in f.values or name in f.kinds or name in self.numbers:
            self._refuse(f, node, f"{name} is a value here and not a function; rename the value")
        if name in self.functions:
            result = Var(self._fresh(name))
            inlined: list[Stmt] = []
            self._call(f, node, (result,), inlined)
            if not whole and any(isinstance(s, Assign) and s.target.state for s in statements(tuple(inlined))):
                self._refuse(f, node, f"{name} sets a state, so its call stands alone, as in y = {name}(...)")
            out += inlined
            return result
        if name == "ago" and len(node.args) == 2 and not node.keywords:
            if not isinstance(node.args[0], ast.Name) or node.args[0].id != f.input:
                self._refuse(f, node, "ago looks back at the step's input alone, ago(x, n)")
            n = self._expr(f, node.args[1], out)
            if any(isinstance(e, (Ago, Var)) and (isinstance(e, Ago) or e.state) for e in leaves(n)):
                self._refuse(f, node, "the lag of ago may not depend on states or the input")
            if self.beginning:
                self._refuse(f, node, "begin runs at the first sample, which has no samples before it; use x")
            self.uses.append((f, node, "lag", n))
            return Ago(n)
        count = (2, 9) if name in ("min", "max") else (1, 1)
        if name not in FUNCTIONS or node.keywords or not count[0] <= len(node.args) <= count[1]:
            self._refuse(f, node)
        values = [self._expr(f, a, out) for a in node.args]
        return fold_constants(name, values) if len(values) > 1 else Op(name, tuple(values))

    def _name(self, f: Frame, node: ast.Name) -> Expr:
        value = f.values.get(node.id)
        if isinstance(value, str):
            return Param(value)
        if value is not None:
            return value
        if node.id in f.locals:
            return Var(f.locals[node.id])
        if node.id in self.numbers:
            return Num(self.numbers[node.id])
        self._refuse(f, node, f"{node.id} has no value here")

    def _kind(self, f: Frame, node: ast.Attribute) -> str:
        return f.kinds.get(node.value.id, "") if isinstance(node.value, ast.Name) else ""

    def _attribute(self, f: Frame, node: ast.Attribute) -> Expr:
        kind = self._kind(f, node)
        if kind == "state":
            self.states[node.attr] = None
            return Var(node.attr, True)
        if kind == "params":
            return Param(node.attr)
        if kind == "block":
            return Const(node.attr)
        self._refuse(f, node)

    def _element(self, f: Frame, node: ast.Subscript, out: list[Stmt]) -> Expr:
        row = f.values.get(node.value.id) if isinstance(node.value, ast.Name) else None
        if isinstance(node.value, ast.Attribute) and self._kind(f, node.value) == "params":
            row = node.value.attr
        if not isinstance(row, str):
            self._refuse(f, node, "only a row of parameters takes an index, p.name[i]")
        index = self._expr(f, node.slice, out)
        self.uses.append((f, node, "index", index))
        return Param(row, index)

    def _fresh(self, name: str) -> str:
        k, fresh_name = 2, name
        while fresh_name in self.taken:
            fresh_name, k = f"{name}_{k}", k + 1
        self.taken.add(fresh_name)
        return fresh_name

    def _refuse(self, f: Frame, node: ast.AST, why: str = "") -> NoReturn:
        line = getattr(node, "lineno", f.first)
        shown = self.text.splitlines()[line - 1].strip()
        shown = shown if len(shown) <= 120 else f"{shown[:117]}..."
        reason = f"{why}; {_ALLOWED}" if why else _ALLOWED
        raise InputError(f"line {line - f.first + 1} of {f.name}, `{shown}`: {reason}")


def constant(e: Expr) -> float | None:
    """The value of an expression of small numbers alone; None for any other."""
    if isinstance(e, Num):
        return e.value
    if not isinstance(e, Op) or e.op not in ("neg", *ARITHMETIC.values()):
        return None
    v = [constant(a) for a in e.args]
    if any(each is None for each in v):
        return None
    try:
        if e.op == "**":
            v = [float(each) for each in v]  # type: ignore[arg-type]
        return evaluate(e.op, *v)  # type: ignore[arg-type]
    except (ArithmeticError, ValueError):
        return None


def fold_constants(op: str, values: list[Expr]) -> Expr:
    out = values[0]
    for v in values[1:]:
        out = Op(op, (out, v))
    return out


def leaves(e: Expr) -> list[Expr]:
    return [v for v in walk(e) if not isinstance(v, Op)]


def variables(e: Expr) -> set[Var]:
    return {v for v in leaves(e) if isinstance(v, Var)}

"""Insert numbers into a program and evaluate constant parts, so that absent features of a block disappear."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.ir import (
    Assign,
    Body,
    Break,
    Const,
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
    ends,
    expressions,
    map_expressions,
    rebuilt,
    statements,
)

_LONGEST = 8  # iterations that are tried one by one
Env = dict[Var, Num]


def specialise(
    program: Program, params: Mapping[str, float], rows: Mapping[str, np.ndarray], structure: Mapping[str, float]
) -> Program:
    """The program of one block: parameters that have a number here become it; others stay, and so do indexed rows."""
    folder = _Folder(params, rows, structure)
    while True:
        folder.reads = _reads((*program.begin, *program.step))
        begin, first = folder.body(program.begin, {})
        still = dict.fromkeys((Var(s, True) for s in program.states), Num(0.0))
        constants = {v: n for v, n in {**still, **(first or {})}.items() if v.state and not _moves(program.step, v, n)}
        constants = {v: n for v, n in constants.items() if v in (first or {}) or not _sets(begin, v)}
        step, _ = folder.body(program.step, dict(constants))
        folded = _without_dead(replace(program, begin=begin, step=step))
        if folded == program:
            return replace(folded, step=rename_variables(folded.step, folded.step))
        program = folded


def without(program: Program, off: Mapping[str, float]) -> Program:
    """The program of blocks that lack these parts of their structure, and the parameters that only the parts read."""
    slim = specialise(program, {}, {}, off)
    read = {e for body in (slim.begin, slim.step) for e in expressions(body)}
    params, consts = ({e.name for e in read if isinstance(e, kind)} for kind in (Param, Const))
    return replace(
        slim,
        params=tuple(name for name in slim.params if name in params),
        consts=tuple(name for name in slim.consts if name in consts),
    )


def _sets(body: Body, v: Var) -> bool:
    return any(isinstance(s, Assign) and s.target == v for s in statements(body))


def _moves(body: Body, v: Var, value: Num) -> bool:
    return any(isinstance(s, Assign) and s.target == v and s.value != value for s in statements(body))


class _Folder:
    def __init__(
        self, params: Mapping[str, float], rows: Mapping[str, np.ndarray], structure: Mapping[str, float]
    ) -> None:
        self.params, self.rows, self.structure = params, rows, structure
        self.reads: Counter[Var] = Counter()  # of the whole program

    def expr(self, e: Expr, env: Env) -> Expr:
        if isinstance(e, Var):
            return env.get(e, e)
        if isinstance(e, Const):
            return Num(self.structure[e.name]) if e.name in self.structure else e
        if isinstance(e, Param) and e.index is None:
            return Num(float(self.params[e.name])) if e.name in self.params else e
        e = rebuilt(e, lambda a: self.expr(a, env))
        if isinstance(e, Param) and isinstance(e.index, Num) and e.name in self.rows:
            row = self.rows[e.name]  # an index beyond it is kept within, as in the kernels
            return Num(float(row[min(max(int(e.index.value), 0), len(row) - 1)]))
        return simple(e) if isinstance(e, Op) else e

    def body(self, body: Body, env: Env) -> tuple[Body, Env | None]:
        """Statements with numbers inserted, and the known values after them; None if control never gets there."""
        out: list[Stmt] = []
        for i, s in enumerate(body):
            if isinstance(s, Assign):
                value = self.expr(s.value, env)
                env = {k: v for k, v in env.items() if k != s.target}
                if isinstance(value, Num):
                    env[s.target] = value
                out.append(Assign(s.target, value))
            elif isinstance(s, If):
                more, known = self._if(s, env)
                out += more
                if known is None:
                    return tuple(out), None
                env = known
            elif isinstance(s, For):
                more, env = self._for(s, env, body)
                out += more
            elif isinstance(s, Return):
                return (*out, Return(self.expr(s.value, env))), None
            elif isinstance(s, Break):
                return (*out, s), None
            if i + 1 < len(body) and out and ends((out[-1],)):
                return tuple(out), None
        return tuple(out), env

    def _if(self, s: If, env: Env) -> tuple[Body, Env | None]:
        test = self.expr(s.test, env)
        if isinstance(test, Num):
            return self.body(s.body if test.value else s.orelse, env)
        (a, known_a), (b, known_b) = self.body(s.body, dict(env)), self.body(s.orelse, dict(env))
        if known_a is None or known_b is None:
            known = known_b if known_a is None else known_a
        else:
            known = {k: v for k, v in known_a.items() if known_b.get(k) == v and _same(v, known_b[k])}
        if not a and b:
            return (If(negate(test), b, ()),), known
        return ((If(test, a, b),) if a or b else ()), known

    def _for(self, s: For, env: Env, around: Body) -> tuple[Body, Env]:
        count = self.expr(s.count, env)
        own_break = any(isinstance(e, Break) for e in _own_level(s.body))
        if isinstance(count, Num) and count.value <= _LONGEST and not own_break:
            rounds, known = [], dict(env)
            for k in range(int(count.value)):
                done, after = self.body(s.body, {**known, Var(s.index): Num(k)})
                known = after or {}
                if not self._idle(done, s.body):
                    rounds.append(done)
            if len(rounds) <= 1:
                return (rounds[0] if rounds else ()), {k: v for k, v in known.items() if k != Var(s.index)}
        assigned = {e.target for e in statements(s.body) if isinstance(e, Assign)} | {Var(s.index)}
        env = {k: v for k, v in env.items() if k not in assigned}
        body, _ = self.body(s.body, dict(env))
        return ((For(s.index, count, body),) if body else ()), env

    def _idle(self, body: Body, loop: Body) -> bool:
        """Whether the statements of a loop set only locals that are not read outside it."""
        reads = _reads(loop)
        return all(
            isinstance(s, Assign) and not s.target.state and self.reads[s.target] == reads[s.target] for s in body
        )


def _reads(body: Body) -> Counter[Var]:
    return Counter(e for e in expressions(body) if isinstance(e, Var))


def _own_level(body: Body) -> list[Stmt]:
    """Statements of a loop's body that are not in a loop within it."""
    level: list[Stmt] = []
    for s in body:
        level.append(s)
        if isinstance(s, If):
            level += [*_own_level(s.body), *_own_level(s.orelse)]
    return level


def _same(a: Num, b: Num) -> bool:
    return type(a.value) is type(b.value)


def _without_dead(program: Program) -> Program:
    """Without assignments of unused values."""
    while True:
        read = {e for body in (program.begin, program.step) for e in expressions(body) if isinstance(e, Var)}
        slim = replace(program, begin=_live_statements(program.begin, read), step=_live_statements(program.step, read))
        states = tuple(s for s in slim.states if Var(s, True) in read)
        slim = replace(slim, states=states)
        if slim == program:
            return slim
        program = slim


def rename_variables(body: Body, whole: Body) -> Body:
    """Without plain copies: the source takes the name of the copy."""
    out = list(body)
    i = 0
    while i < len(out):
        s = out[i]
        if isinstance(s, If):
            out[i] = replace(s, body=rename_variables(s.body, whole), orelse=rename_variables(s.orelse, whole))
        elif isinstance(s, For):
            out[i] = replace(s, body=rename_variables(s.body, whole))
        elif isinstance(s, Assign) and isinstance(s.value, Var) and _handed(s.target, s.value, out, i, whole):
            old, new = s.value, s.target
            out[:i] = _name_value(tuple(out[:i]), old, new)
            del out[i]
            continue
        i += 1
    return tuple(out)


def _handed(new: Var, old: Var, body: list[Stmt], i: int, whole: Body) -> bool:
    """Whether `old` is live only before statement i, and `new` only from there on."""
    if new.state or old.state or not _sets(tuple(body[:i]), old):
        return False
    early, late = tuple(body[:i]), tuple(body[i + 1 :])
    all_old, all_new = _uses(whole, old), _uses(whole, new)
    return _uses(early, old) + 1 == all_old and _uses(late, new) + 1 == all_new


def _uses(body: Body, v: Var) -> int:
    set_ = sum(1 for s in statements(body) if isinstance(s, Assign) and s.target == v)
    return set_ + sum(1 for e in expressions(body) if e == v)


def _name_value(body: Body, old: Var, new: Var) -> Body:
    def f(e: Expr) -> Expr:
        return new if e == old else rebuilt(e, f)

    out: list[Stmt] = []
    for s in map_expressions(body, f):
        if isinstance(s, Assign) and s.target == old:
            s = replace(s, target=new)
        elif isinstance(s, If):
            s = replace(s, body=_name_value(s.body, old, new), orelse=_name_value(s.orelse, old, new))
        elif isinstance(s, For):
            s = replace(s, body=_name_value(s.body, old, new))
        out.append(s)
    return tuple(out)


def _live_statements(body: Body, read: set[Var]) -> Body:
    out: list[Stmt] = []
    for s in body:
        if isinstance(s, Assign):
            if s.target in read and s.value != s.target:
                out.append(s)
        elif isinstance(s, If):
            a, b = _live_statements(s.body, read), _live_statements(s.orelse, read)
            if a or b:
                out.append(If(s.test, a, b) if a else If(negate(s.test), b, ()))
        elif isinstance(s, For):
            inner = _live_statements(s.body, read)
            if inner:
                out.append(replace(s, body=inner))
        else:
            out.append(s)
    return tuple(out)


_FLIPPED = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}


def negate(test: Expr) -> Expr:
    """The opposite of a test."""
    if isinstance(test, Op) and test.op == "not":
        return test.args[0]
    if isinstance(test, Op) and test.op in ("==", "!="):
        return replace(test, op=_FLIPPED[test.op])
    return Op("not", (test,))


def simple(e: Op) -> Expr:
    """An operation with simple arguments, evaluated or removed if its numbers allow it."""
    if all(isinstance(a, Num) for a in e.args):
        try:
            return Num(evaluate(e.op, *(a.value for a in e.args)))  # type: ignore[union-attr]
        except (ArithmeticError, ValueError):
            return e
    if e.op == "if":
        test, a, b = e.args
        return (a if test.value else b) if isinstance(test, Num) else a if a == b else e
    if e.op == "neg":
        inner = e.args[0]
        return inner.args[0] if isinstance(inner, Op) and inner.op == "neg" else e
    return _pair(e) if len(e.args) == 2 else e


def _pair(e: Op) -> Expr:
    """An operation on two arguments, one of which may be a number."""
    a, b = e.args
    x, y = (v.value if isinstance(v, Num) else None for v in (a, b))
    op = e.op
    if op in ("and", "or"):
        for value, other in ((x, b), (y, a)):
            if value is not None:
                return Num(bool(value)) if bool(value) == (op == "or") else other
    if op in ("<", "<=", ">", ">="):
        return _against_infinity(e, x, y)
    if op == "+":
        if isinstance(y, float) and y < 0.0:
            return Op("-", (a, Num(-y)))
        return b if x == 0 else a if y == 0 else e
    if op == "-":
        if isinstance(y, float) and y < 0.0:
            return Op("+", (a, Num(-y)))
        return Op("neg", (b,)) if x == 0 else a if y == 0 else e
    if op == "*":
        return Num(0.0) if 0 in (x, y) else b if x == 1 else a if y == 1 else e
    if op == "/":
        return Num(0.0) if x == 0 else a if y == 1 else e
    if op in ("min", "max"):
        beyond = math.inf if op == "min" else -math.inf
        return b if x == beyond else a if y == beyond else e
    return e


def _against_infinity(e: Op, x: float | None, y: float | None) -> Expr:
    """Comparison of a finite number with an infinite one."""
    for value, upside in ((x, e.op[0] == ">"), (y, e.op[0] == "<")):
        if value is not None and math.isinf(value):
            return Num((value > 0) == upside)
    return e


def evaluate(op: str, *v: float) -> float:
    table: dict[str, Callable[..., float]] = {
        "+": lambda a, b: a + b,
        "-": lambda a, b: a - b,
        "*": lambda a, b: a * b,
        "/": lambda a, b: a / b,
        "**": lambda a, b: a**b,
        "neg": lambda a: -a,
        "<": lambda a, b: a < b,
        "<=": lambda a, b: a <= b,
        ">": lambda a, b: a > b,
        ">=": lambda a, b: a >= b,
        "==": lambda a, b: a == b,
        "!=": lambda a, b: a != b,
        "and": lambda a, b: bool(a and b),
        "or": lambda a, b: bool(a or b),
        "not": lambda a: not a,
        "if": lambda t, a, b: a if t else b,
    }
    return FUNCTIONS[op].value(*v) if op in FUNCTIONS else table[op](*v)

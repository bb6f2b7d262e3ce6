"""The parts of a program with derivatives, and conditional values as statements, so that the branch is known."""

from dataclasses import dataclass, replace

from sysid.block.compiler.functions import FLAT
from sysid.block.compiler.ir import (
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
    map_expressions,
    rebuilt,
    statements,
    walk,
)


@dataclass(frozen=True)
class Activity:
    """Variables by the form of their derivative. active: any derivative.

    light: only with respect to single parameters, stored as numbers. inputs: one sample of the input, stored as its
    row. The others store a vector with one entry for each column of the Jacobian.
    """

    active: frozenset[Var]
    light: frozenset[Var]
    inputs: frozenset[Var]

    def of(self, e: Expr) -> bool:
        """Whether the derivative of an expression may be nonzero."""
        if isinstance(e, (Param, Ago)):
            return True
        if isinstance(e, Var):
            return e in self.active
        if not isinstance(e, Op) or e.op in FLAT:
            return False
        return any(self.of(a) for a in (e.args[1:] if e.op == "if" else e.args))

    def leaves(self, e: Expr) -> list[Expr]:
        """Variables, parameters and inputs on which the derivative of an expression depends."""
        if not self.of(e):
            return []
        if not isinstance(e, Op):
            return [e]
        return [leaf for a in (e.args[1:] if e.op == "if" else e.args) for leaf in self.leaves(a)]

    def vectors(self, e: Expr) -> set[Var]:
        """Variables whose vectors the derivative of an expression needs."""
        return {v for v in self.leaves(e) if isinstance(v, Var) and v not in self.light and v not in self.inputs}


def activity(program: Program) -> Activity:
    """Which variables carry derivatives, anywhere in the program."""
    assigned = [s for body in (program.begin, program.step) for s in statements(body) if isinstance(s, Assign)]
    active_parts = Activity(frozenset(), frozenset(), frozenset())
    while True:
        active = frozenset(s.target for s in assigned if active_parts.of(s.value))
        if active == active_parts.active:
            break
        active_parts = replace(active_parts, active=active_parts.active | active)
    light = frozenset(v for v in active_parts.active if not v.state)
    while True:
        remaining = light - {
            s.target for s in assigned if not all(_light(leaf, light) for leaf in active_parts.leaves(s.value))
        }
        if remaining == light:
            break
        light = remaining
    once = [s for s in assigned if sum(o.target == s.target for o in assigned) == 1]
    inputs = frozenset(s.target for s in once if isinstance(s.value, Ago) and not s.target.state)
    return Activity(active_parts.active, light, inputs)


def _light(leaf: Expr, light: frozenset[Var]) -> bool:
    return (isinstance(leaf, Param) and leaf.index is None) or leaf in light


def lower_branches(body: Body, found: Activity, taken: set[str]) -> Body:
    """The same with differentiable if-else values, min and max written as statements."""
    out: list[Stmt] = []
    for s in body:
        if isinstance(s, Assign):
            _assign(s.target, s.value, found, taken, out)
        elif isinstance(s, If):
            out.append(
                replace(s, body=lower_branches(s.body, found, taken), orelse=lower_branches(s.orelse, found, taken))
            )
        elif isinstance(s, For):
            out.append(replace(s, body=lower_branches(s.body, found, taken)))
        elif isinstance(s, Return):
            out.append(Return(_plain(s.value, found, taken, out)))
        else:
            out.append(s)
    return tuple(out)


def _branches(e: Expr, found: Activity) -> bool:
    """Whether the derivative of this expression itself depends on a comparison."""
    return isinstance(e, Op) and e.op in ("if", "min", "max") and found.of(e)


def _assign(target: Var, e: Expr, found: Activity, taken: set[str], out: list[Stmt]) -> None:
    if not _branches(e, found):
        out.append(Assign(target, _plain(e, found, taken, out)))
        return
    assert isinstance(e, Op)
    if e.op == "if":
        test, args = e.args[0], e.args[1:]
    else:
        a, b = (_atom(arg, found, taken, out) for arg in e.args)
        # As Python has it: the first one, unless the second is smaller (min) or larger (max).
        test, args = Op("<" if e.op == "min" else ">", (b, a)), (b, a)
    sides: list[list[Stmt]] = [[], []]
    for side, arg in zip(sides, args, strict=True):
        if arg != target:
            _assign(target, arg, found, taken, side)
    out.append(If(test, tuple(sides[0]), tuple(sides[1])))


def _plain(e: Expr, found: Activity, taken: set[str], out: list[Stmt]) -> Expr:
    """The expression, with its branching parts as statements before it."""
    if _branches(e, found):
        return _name_part(e, found, taken, out)
    if not found.of(e):
        return e
    return rebuilt(e, lambda a: _plain(a, found, taken, out))


def _atom(e: Expr, found: Activity, taken: set[str], out: list[Stmt]) -> Expr:
    """The expression, or a name for it if it would occur twice."""
    return _name_part(e, found, taken, out) if isinstance(e, Op) else e


def _name_part(e: Expr, found: Activity, taken: set[str], out: list[Stmt]) -> Var:
    k = 1
    while f"part{k}" in taken:
        k += 1
    taken.add(f"part{k}")
    target = Var(f"part{k}")
    _assign(target, e, found, taken, out)
    return target


def hoist_constants(program: Program) -> Program:
    """The same, with expressions of only parameters and structure computed once before the first sample."""
    assigned = [s.target for body in (program.begin, program.step) for s in statements(body) if isinstance(s, Assign)]
    constants: set[Var] = set()
    early: list[Stmt] = []
    late: list[Stmt] = []
    for s in program.step:
        alone = isinstance(s, Assign) and not s.target.state and assigned.count(s.target) == 1
        if alone and isinstance(s, Assign) and all(_constant(e, constants) for e in walk(s.value)):
            constants.add(s.target)
            early.append(s)
        else:
            late.append(s)

    def checked(e: Expr) -> Expr:
        e = rebuilt(e, checked)
        return replace(e, checked=True) if isinstance(e, Ago) and all(_constant(n, constants) for n in walk(e.n)) else e

    return replace(program, begin=(*early, *program.begin), step=map_expressions(tuple(late), checked))


def delays(program: Program) -> list[Expr]:
    """The largest input lag of a hoisted program, if it is constant."""
    return [e.n for e in expressions(program.step) if isinstance(e, Ago) and e.checked and not isinstance(e.n, Num)]


def _constant(e: Expr, known: set[Var]) -> bool:
    return e in known if isinstance(e, Var) else not isinstance(e, Ago) and not (isinstance(e, Param) and e.index)


def names(program: Program) -> set[str]:
    """All local names of a program."""
    local_names = {
        s.target.name for body in (program.begin, program.step) for s in statements(body) if isinstance(s, Assign)
    }
    local_names |= {s.index for body in (program.begin, program.step) for s in statements(body) if isinstance(s, For)}
    return local_names


def alive(body: Body, out: frozenset[Var], left: frozenset[Var], states: frozenset[Var], found: Activity) -> frozenset:
    """Variables whose vectors are needed from here on; `out` after the body, `left` after a break."""
    for s in reversed(body):
        if isinstance(s, Assign):
            out = (out - {s.target}) | found.vectors(s.value)
        elif isinstance(s, If):
            out = alive(s.body, out, left, states, found) | alive(s.orelse, out, left, states, found)
        elif isinstance(s, For):
            out = head(s, out, states, found)
        elif isinstance(s, Break):
            out = left
        elif isinstance(s, Return):
            out = states | found.vectors(s.value)
    return out


def head(loop: For, out: frozenset[Var], states: frozenset[Var], found: Activity) -> frozenset[Var]:
    """Variables whose vectors are needed at the head of a loop; `out` after it."""
    needed = out
    while True:
        wider = needed | alive(loop.body, needed, out, states, found)
        if wider == needed:
            return needed
        needed = wider


def now(e: Expr) -> bool:
    """Whether an expression is the current input."""
    return isinstance(e, Ago) and e.n == Num(0)


def looks_back(program: Program) -> bool:
    """Whether the program reads earlier samples of the input."""
    return any(isinstance(e, Ago) and not now(e) for e in expressions(program.step))


def memoryless(program: Program) -> bool:
    """Whether the output hangs on the present input alone."""
    return not program.states and not looks_back(program)

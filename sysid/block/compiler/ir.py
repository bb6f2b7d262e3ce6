"""The small language of a step: expressions, statements, and traversals."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")


@dataclass(frozen=True)
class Num:
    """A number: float, int or bool."""

    value: float


@dataclass(frozen=True)
class Var:
    """A local variable, or a state of the block."""

    name: str
    state: bool = False


@dataclass(frozen=True)
class Param:
    """A parameter, or with an index one of a row of parameters."""

    name: str
    index: "Expr | None" = None


@dataclass(frozen=True)
class Const:
    """A value of the block's structure."""

    name: str


@dataclass(frozen=True)
class Ago:
    """The input n samples ago; before the record its first sample. `checked`: n is known not to be negative."""

    n: "Expr"
    checked: bool = False


@dataclass(frozen=True)
class Op:
    """+ - * / ** neg, a comparison, and, or, not, one of `functions`, or `if` (test, value, other value)."""

    op: str
    args: tuple["Expr", ...]


Expr = Num | Var | Param | Const | Ago | Op


@dataclass(frozen=True)
class Assign:
    target: Var
    value: Expr


@dataclass(frozen=True)
class If:
    test: Expr
    body: tuple["Stmt", ...]
    orelse: tuple["Stmt", ...]


@dataclass(frozen=True)
class For:
    index: str
    count: Expr
    body: tuple["Stmt", ...]


@dataclass(frozen=True)
class Break:
    pass


@dataclass(frozen=True)
class Return:
    value: Expr


Stmt = Assign | If | For | Break | Return
Body = tuple[Stmt, ...]


@dataclass(frozen=True)
class Program:
    """A block's recursion: `begin` sets the states from the first input; `step` updates them and returns the output."""

    states: tuple[str, ...]
    params: tuple[str, ...]  # single ones
    rows: tuple[str, ...]  # rows of parameters
    consts: tuple[str, ...]
    begin: Body
    step: Body


def children(e: Expr) -> tuple[Expr, ...]:
    """The expressions right below."""
    if isinstance(e, Op):
        return e.args
    if isinstance(e, Param):
        return () if e.index is None else (e.index,)
    return (e.n,) if isinstance(e, Ago) else ()


def walk(e: Expr) -> Iterator[Expr]:
    """The expression and all its subexpressions."""
    yield e
    for child in children(e):
        yield from walk(child)


def rebuilt(e: Expr, f: Callable[[Expr], Expr]) -> Expr:
    """The expression with f applied to its arguments."""
    if isinstance(e, Op):
        return replace(e, args=tuple(f(a) for a in e.args))
    if isinstance(e, Param) and e.index is not None:
        return replace(e, index=f(e.index))
    return replace(e, n=f(e.n)) if isinstance(e, Ago) else e


def map_expressions(body: Body, f: Callable[[Expr], Expr]) -> Body:
    """The statements with f applied to every expression that they read."""
    out: list[Stmt] = []
    for s in body:
        if isinstance(s, (Assign, Return)):
            out.append(replace(s, value=f(s.value)))
        elif isinstance(s, If):
            out.append(If(f(s.test), map_expressions(s.body, f), map_expressions(s.orelse, f)))
        elif isinstance(s, For):
            out.append(For(s.index, f(s.count), map_expressions(s.body, f)))
        else:
            out.append(s)
    return tuple(out)


def statements(body: Body) -> Iterator[Stmt]:
    """All statements, nested ones included."""
    for s in body:
        yield s
        if isinstance(s, If):
            yield from statements(s.body)
            yield from statements(s.orelse)
        elif isinstance(s, For):
            yield from statements(s.body)


def expressions_of(s: Stmt) -> tuple[Expr, ...]:
    """The expressions that a statement reads itself."""
    if isinstance(s, (Assign, Return)):
        return (s.value,)
    if isinstance(s, If):
        return (s.test,)
    return (s.count,) if isinstance(s, For) else ()


def expressions(body: Body) -> Iterator[Expr]:
    """All expressions of all statements, with subexpressions."""
    for s in statements(body):
        for e in expressions_of(s):
            yield from walk(e)


def loops(s: Stmt) -> bool:
    """Whether this statement contains a loop."""
    return any(isinstance(each, For) for each in statements((s,)))


def ends(body: Body) -> bool:
    """Whether control never reaches the end: every path breaks or returns."""
    if not body:
        return False
    last = body[-1]
    return isinstance(last, (Break, Return)) or (isinstance(last, If) and ends(last.body) and ends(last.orelse))

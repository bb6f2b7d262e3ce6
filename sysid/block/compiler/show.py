"""Expressions as text of the compiled kernels."""

from sysid.block.compiler.ir import COMPARISONS, Ago, Const, Expr, Num, Op, Param, Var


def variable(v: Var) -> str:
    """The name of a variable or a state in a kernel."""
    return f"s_{v.name}" if v.state else f"v_{v.name}"


def show(e: Expr, args: list[str] | None = None, place: bool = False) -> str:
    """An expression; `args` are texts of its arguments; `place` gives the position of a row's parameter in theta."""
    if isinstance(e, Num):
        return repr(e.value) if e.value >= 0 else f"({e.value!r})"
    if isinstance(e, Var):
        return variable(e)
    if isinstance(e, Const):
        return f"k_{e.name}"
    if isinstance(e, Param):
        if e.index is None:
            return f"p_{e.name}"
        # Whatever a state has become, memory beside the row is not touched.
        where = f"a_{e.name} + min(max({show(e.index)}, 0), n_{e.name} - 1)"
        return where if place else f"theta[{where}]"
    if isinstance(e, Ago):
        return "u" if e.n == Num(0) else f"x[{row(e)}]"
    a = [show(each) for each in e.args] if args is None else list(args)
    if e.op == "**" and not isinstance(e.args[0], (Param, Ago)):  # whole numbers to a negative power, or beyond 2**63
        base = e.args[0]
        a[0] = f"{float(base.value)!r}" if isinstance(base, Num) and base.value >= 0 else f"float({a[0]})"
    return operation(e, a)


def row(e: Ago) -> str:
    """Sample number of an earlier input."""
    return f"max(t - {show(e.n) if e.checked else f'max({show(e.n)}, 0)'}, 0)"


def operation(e: Op, a: list[str]) -> str:
    """An operation on written arguments, in brackets if needed."""
    if e.op in ("+", "-", "*", "/", "**", "and", "or", *COMPARISONS):
        return f"({a[0]} {e.op} {a[1]})"
    if e.op == "neg":
        return f"(-{a[0]})"
    if e.op == "not":
        return f"(not {a[0]})"
    if e.op == "if":
        return f"({a[1]} if {a[0]} else {a[2]})"
    if e.op == "sign":
        return f"sign({a[0]})"
    return f"{e.op}({', '.join(a)})"

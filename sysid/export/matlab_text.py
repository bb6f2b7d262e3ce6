"""The body of an exported Python function as MATLAB, statement by statement.

The exporters write a small subset of Python: assignments to numbers, lists and their parts, if, for over a range,
break, one return in each branch, and a few functions of math. What is beyond it is refused, never guessed.
"""

import ast
from collections.abc import Sequence

from sysid.base.errors import InputError
from sysid.block.compiler.functions import MATLAB

FUNCTIONS = {f"math.{name}": name for name in ("atan", "atan2", "ceil", "hypot", "tan")} | MATLAB | {"sum": "sum"}
RESERVED = {"case", "catch", "end", "function", "global", "otherwise", "parfor", "persistent", "switch", "until"}
PICK = "pick_"  # the function of the file that stands for `a if test else b` within an expression

_OR, _AND, _NOT, _COMPARE, _SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(1, 10)
_BINARY = {
    ast.Add: ("+", _SUM),
    ast.Sub: ("-", _SUM),
    ast.Mult: ("*", _PRODUCT),
    ast.Div: ("/", _PRODUCT),
    ast.Pow: ("^", _POWER),
}
_COMPARED = {ast.Eq: "==", ast.NotEq: "~=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}


def matlab(body: str) -> list[str]:
    """Lines of a MATLAB function body with the result `out`, for the body of a Python function of s, x and tables.

    Raises InputError for a statement or expression beyond the subset.
    """
    text = "def f():\n" + "\n".join(f"    {line}" for line in body.split("\n"))
    (function,) = ast.parse(text).body
    assert isinstance(function, ast.FunctionDef)
    return _block(function.body)


def _block(body: Sequence[ast.stmt]) -> list[str]:
    return [line for statement in body for line in _statement(statement)]


def _indent(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _statement(s: ast.stmt) -> list[str]:
    if isinstance(s, ast.Assign) and len(s.targets) == 1:
        return _assign(s.targets[0], s.value)
    if isinstance(s, ast.AugAssign) and isinstance(s.op, ast.Add):
        if _is_list(s.value):
            target = show(s.target)
            return [f"{target} = [{target}, {show(s.value)}];"]
        return _assign(s.target, ast.BinOp(_read(s.target), ast.Add(), s.value))
    if isinstance(s, ast.If):
        return [*_if_statement(s, "if"), "end"]
    if isinstance(s, ast.For) and isinstance(s.target, ast.Name):
        return [f"for {_name(s.target.id)} = {_range(s.iter)}", *_indent(_block(s.body)), "end"]
    if isinstance(s, ast.Return) and s.value is not None:
        return [f"out = {show(s.value)};", "return"]
    if isinstance(s, ast.Break):
        return ["break"]
    raise _refusal(s)


def _assign(target: ast.expr, value: ast.expr) -> list[str]:
    if isinstance(target, ast.Tuple):
        sequence = value.value if isinstance(value, ast.Subscript) else value
        if not isinstance(sequence, ast.Name):
            raise _refusal(value)
        return [f"{show(t)} = {show(sequence)}({k});" for k, t in enumerate(target.elts, 1)]
    if isinstance(value, ast.IfExp):  # as a statement, only the chosen side is evaluated
        lines = [f"if {show(value.test)}", *_indent(_assign(target, value.body))]
        return [*lines, "else", *_indent(_assign(target, value.orelse)), "end"]
    return [f"{show(target)} = {show(value)};"]


def _if_statement(s: ast.If, word: str) -> list[str]:
    lines = [f"{word} {show(s.test)}", *_indent(_block(s.body))]
    if len(s.orelse) == 1 and isinstance(s.orelse[0], ast.If):
        return [*lines, *_if_statement(s.orelse[0], "elseif")]
    return [*lines, *(["else", *_indent(_block(s.orelse))] if s.orelse else [])]


def show(e: ast.expr, outer_binding: int = 0) -> str:
    """An expression, in brackets where what is around it binds more tightly."""
    text, binds = _expression(e)
    return f"({text})" if binds < outer_binding else text


def _expression(e: ast.expr) -> tuple[str, int]:
    if isinstance(e, ast.Constant):
        return _constant(e)
    if isinstance(e, ast.Name):
        return _name(e.id), _ATOM
    if isinstance(e, ast.Attribute) and ast.unparse(e) == "math.inf":
        return "Inf", _ATOM
    if isinstance(e, ast.BinOp):
        return _binary(e)
    if isinstance(e, ast.UnaryOp) and isinstance(e.op, ast.USub):
        return f"-{show(e.operand, _SIGN)}", _SIGN
    if isinstance(e, ast.UnaryOp) and isinstance(e.op, ast.Not):
        return f"~{show(e.operand, _ATOM)}", _NOT
    if isinstance(e, ast.BoolOp):
        sign, binds = ("&&", _AND) if isinstance(e.op, ast.And) else ("||", _OR)
        return f" {sign} ".join(show(v, binds + 1) for v in e.values), binds
    if isinstance(e, ast.Compare) and len(e.ops) == 1 and type(e.ops[0]) in _COMPARED:
        sign = _COMPARED[type(e.ops[0])]
        return f"{show(e.left, _SUM)} {sign} {show(e.comparators[0], _SUM)}", _COMPARE
    if isinstance(e, ast.IfExp):
        return f"{PICK}({show(e.test)}, {show(e.body)}, {show(e.orelse)})", _ATOM
    if isinstance(e, ast.Call) and not e.keywords and ast.unparse(e.func) in FUNCTIONS:
        return f"{FUNCTIONS[ast.unparse(e.func)]}({', '.join(show(a) for a in e.args)})", _ATOM
    if isinstance(e, ast.Subscript):
        return f"{show(e.value)}({_index(e.slice, show(e.value))})", _ATOM
    if isinstance(e, ast.List):
        return f"[{', '.join(show(v) for v in e.elts)}]", _ATOM
    if isinstance(e, (ast.ListComp, ast.GeneratorExp)):
        return _comprehension(e), _ATOM
    raise _refusal(e)


def _binary(e: ast.BinOp) -> tuple[str, int]:
    if isinstance(e.op, ast.Add) and (_is_list(e.left) or _is_list(e.right)):  # one row behind the other
        return f"[{_elements(e.left)}, {_elements(e.right)}]", _ATOM
    if isinstance(e.op, ast.Mult) and _is_list(e.left):
        return f"repmat({show(e.left)}, 1, {show(e.right)})", _ATOM
    if type(e.op) not in _BINARY:
        raise _refusal(e)
    sign, binds = _BINARY[type(e.op)]
    left_text, right = show(e.left, binds + (sign == "^")), show(e.right, binds + 1)
    space = "" if sign == "^" else " "
    return f"{left_text}{space}{sign}{space}{right}", binds


def _elements(e: ast.expr) -> str:
    return ", ".join(show(v) for v in e.elts) if isinstance(e, ast.List) else show(e)


def _comprehension(e: ast.ListComp | ast.GeneratorExp) -> str:
    """A row of values, one for each number of a range."""
    (loop,) = e.generators
    if loop.ifs or not isinstance(loop.target, ast.Name):
        raise _refusal(e)
    return f"arrayfun(@({_name(loop.target.id)}) {show(e.elt)}, {_range(loop.iter)})"


def _range(e: ast.expr) -> str:
    if not (isinstance(e, ast.Call) and ast.unparse(e.func) == "range" and len(e.args) == 1):
        raise _refusal(e)
    (count,) = e.args
    if isinstance(count, ast.Constant) and isinstance(count.value, int):
        return f"0:{count.value - 1}"
    return f"0:{show(count, _SUM)} - 1"


def _index(e: ast.expr, row: str) -> str:
    """A place or a part of a row, counted from 1 instead of 0."""
    if not isinstance(e, ast.Slice):
        return _plus_one(e)
    if e.step is not None:
        raise _refusal(e)
    first = "1" if e.lower is None else _plus_one(e.lower)
    if e.upper is None:
        return f"{first}:end"
    distance_from_end = (
        e.upper.operand if isinstance(e.upper, ast.UnaryOp) and isinstance(e.upper.op, ast.USub) else None
    )
    return (
        f"{first}:{show(e.upper, _SUM) if distance_from_end is None else f'end - {show(distance_from_end, _PRODUCT)}'}"
    )


def _plus_one(e: ast.expr) -> str:
    """A number and one, added where it is known."""
    if isinstance(e, ast.Constant) and type(e.value) is int:
        return str(e.value + 1)
    if isinstance(e, ast.BinOp) and isinstance(e.op, ast.Add) and isinstance(e.right, ast.Constant):
        return f"{show(e.left, _SUM)} + {e.right.value + 1}"  # type: ignore[operator]
    return f"{show(e, _SUM)} + 1"


def _constant(e: ast.Constant) -> tuple[str, int]:
    if isinstance(e.value, bool):
        return str(e.value).lower(), _ATOM
    if not isinstance(e.value, (int, float)):
        raise _refusal(e)
    return repr(e.value), _ATOM


def _name(name: str) -> str:
    return f"{name}_" if name in RESERVED else name


def _is_list(e: ast.expr) -> bool:
    return isinstance(e, (ast.List, ast.ListComp)) or (
        isinstance(e, ast.BinOp) and isinstance(e.op, ast.Mult) and isinstance(e.left, ast.List)
    )


def _read(e: ast.expr) -> ast.expr:
    """A target as a value."""
    found = ast.parse(ast.unparse(e), mode="eval").body
    return found


def _refusal(node: ast.AST) -> InputError:
    return InputError(
        f"{ast.unparse(node).splitlines()[0]!r} of the exported code cannot be written as MATLAB; export to C or Python"
    )

"""Small faults that can be put into a module: which, where, and the source with one of them."""

import ast
import copy
from collections.abc import Iterator

SWAPS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
SWAPS |= {ast.Mod: ast.Mult, ast.FloorDiv: ast.Mult, ast.And: ast.Or, ast.Or: ast.And, ast.Lt: ast.LtE, ast.LtE: ast.Lt}
SWAPS |= {ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In}
SWAPS |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd}
OPPOSITE = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
WORDS = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "argmin": "argmax", "all": "any"}
SILENT = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)  # sentences for people, or no numbers


def variants(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that may stand in place of this one: other operator, sign, constant, index or word."""

    def copy_with(**fields) -> ast.AST:
        new = copy.copy(node)
        vars(new).update(fields)
        return new

    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPS:
        yield copy_with(op=SWAPS[type(node.op)]())
    elif isinstance(node, ast.Compare):
        for table in (SWAPS, OPPOSITE):
            if type(node.ops[0]) in table:
                yield copy_with(ops=[table[type(node.ops[0])](), *node.ops[1:]])
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield copy_with(value=not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield copy_with(value=node.value + 1)
        if node.value:
            yield copy_with(value=node.value * 2 if isinstance(node.value, int) else node.value * 1.5)
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in WORDS:
        yield copy_with(id=WORDS[node.id])
    elif isinstance(node, ast.Attribute) and node.attr in WORDS:
        yield copy_with(attr=WORDS[node.attr])
    elif isinstance(node, ast.Return) and isinstance(node.value, ast.BinOp):
        yield copy_with(value=ast.BinOp(node.value, ast.Mult(), ast.Constant(2)))


def sites(node: ast.AST, statement: ast.stmt | None = None) -> Iterator[tuple[ast.AST, ast.stmt]]:
    """Every node that may be changed, with the statement that it is in; no annotations, decorators or sentences."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_comment"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, SILENT) or not isinstance(child, ast.AST):
                continue
            owner = child if isinstance(child, ast.stmt) else statement
            if owner is not None and hasattr(child, "lineno"):
                yield child, owner
            yield from sites(child, owner)


def splice(text: str, node: ast.AST, new: ast.AST) -> str:
    """The source with `new` in place of `node`; columns count bytes."""
    lines = text.encode().splitlines(keepends=True)
    first, last = node.lineno - 1, node.end_lineno - 1
    middle = ast.unparse(new) if isinstance(new, ast.stmt) else f"({ast.unparse(new)})"
    ends = lines[first][: node.col_offset], lines[last][node.end_col_offset :]
    return b"".join([*lines[:first], ends[0], middle.encode(), ends[1], *lines[last + 1 :]]).decode()

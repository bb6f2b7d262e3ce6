"""The tree of a block's C99 as a function of Modelica: parameters and old states in, output and new states out."""

from dataclasses import dataclass, field

from sysid.base.errors import InputError
from sysid.block.writing import CCode, number
from sysid.export.c_tree import (
    Body,
    Break,
    Declare,
    Expr,
    For,
    If,
    Num,
    Op,
    Ref,
    Set,
    Stmt,
    leaves_loop,
    statements,
    tree,
)

_WORDS = """algorithm and annotation block break class connect connector constant constrainedby der discrete each else
elseif elsewhen encapsulated end enumeration equation expandable extends external false final flow for function if
import impure in initial inner input loop model not operator or outer output package parameter partial protected public
pure record redeclare replaceable return stream then true type when while within"""
_TAKEN = "Real Integer Boolean String time pre sample size integer min max sum abs floor sqrt exp log sin cos acos tanh"
WORDS = {*_WORDS.split(), *_TAKEN.split()}
TYPES = {"double": "Real", "long": "Integer", "int": "Boolean"}
HELPERS = {
    "truncated": """  function truncated "The whole number towards zero"
    input Real x;
    output Integer n;
  algorithm
    n := if x < 0.0 then -integer(-x) else integer(x);
  end truncated;""",
    "sum_of": """  function sum_of "The sum of a[k + i]*b[i]"
    input Real a[:];
    input Integer k;
    input Real b[:];
    output Real total;
  algorithm
    total := 0.0;
    for i in 1:size(b, 1) loop
      total := total + a[k + i]*b[i];
    end for;
  end sum_of;""",
}
GO = " go"  # whether a loop goes on: no name of C
_INFINITE = "1.7976931348623157e308"  # Modelica has no infinite number: the largest one stands for it
_FUNCTIONS = {"fabs": "abs", "min_of": "min", "max_of": "max"} | {
    name: name for name in ("exp", "log", "sqrt", "sin", "cos", "acos", "tanh", "floor")
}
_SIGNS = {"==": "==", "!=": "<>", "&&": "and", "||": "or"} | {s: s for s in ("<", "<=", ">", ">=", "+", "-", "*", "/")}
_RANKS = {"?": 0, "||": 1, "&&": 2, "!": 3, **dict.fromkeys(("==", "!=", "<", "<=", ">", ">="), 4)}
_RANKS |= {"+": 5, "-": 5, "neg": 5, "*": 6, "/": 6, "pow": 7}
_TRUTHS = ("&&", "||", "!", "==", "!=", "<", "<=", ">", ">=")


def word(name: str) -> str:
    """A name, with _ behind it where it has a meaning in Modelica."""
    return f"{name}_" if name in WORDS else name


def real(value: float) -> str:
    """A number as Modelica has it."""
    return number(value).replace("inf", _INFINITE)


def function(name: str, code: CCode) -> str:
    """One sample of a unit.

    Its inputs are x, `first` where the code has a beginning, parameters p_..., states old_...; outputs are the result
    and the states s_....
    """
    return _Function(code).text(name)


@dataclass
class _Function:
    code: CCode
    used: set[str] = field(default_factory=lambda: {"x", "y", "result", "first"})
    declared: dict[str, tuple[str, int | None]] = field(default_factory=dict)  # by the name in Modelica
    names: dict[str, str] = field(default_factory=dict)  # of what can be seen, by the name in C
    locals: set[str] = field(default_factory=set)  # names of all variables

    def text(self, name: str) -> str:
        """The whole function."""
        code, (n_in, n_out) = self.code, self.code.channels
        self.used |= {f"p_{f}" for f in code.fields} | {f"{of}_{f}" for f in code.states for of in ("s", "old")}
        self.names["x"] = "x"
        if n_out > 1 or n_in > 1:
            self.names["y"] = "y"
        begin, body = tree(code.begin), tree(code.body)
        self.locals = {word(s.name) for s in statements(begin + body) if isinstance(s, Declare)}
        lines = [f"s_{state} := old_{state};" for state in code.states]
        lines += ["if first then", *_indent(self.body(begin)), "end if;"] if begin else []
        lines += self.body(body)
        inputs = [_sized("x", None if (n_in, n_out) == (1, 1) else n_in)]
        inputs += ["Boolean first"] if begin else []
        inputs += [_sized(f"p_{f}", None if isinstance(at, int) else len(at)) for f, at in code.fields.items()]
        inputs += [_sized(f"old_{f}", n or None) for f, n in code.states.items()]
        outputs = [_sized("result", None) if (n_in, n_out) == (1, 1) else _sized("y", n_out)]
        outputs += [_sized(f"s_{f}", n or None) for f, n in code.states.items()]
        local = [
            f"constant Real {word(k)}[{len(v)}] = {{{', '.join(real(x) for x in v)}}};" for k, v in code.tables.items()
        ]
        local += [f"{TYPES[kind]} {each}{_size(length)};" for each, (kind, length) in self.declared.items()]
        parts = [f"function {name}", *_indent([f"input {i};" for i in inputs] + [f"output {o};" for o in outputs])]
        parts += ["protected", *_indent(local)] if local else []
        return "\n".join(_indent([*parts, "algorithm", *_indent(lines), f"end {name};"]))

    # Statements

    def body(self, body: Body) -> list[str]:
        """Statements with names of their own, which end with them."""
        seen = dict(self.names)
        lines = [line for s in body for line in self.statement(s)]
        self.names = seen
        return lines

    def statement(self, s: Stmt) -> list[str]:
        if isinstance(s, Declare):
            return self.declare(s)
        if isinstance(s, Set):
            kind = self.kind(s.target)
            return [f"{self.show(s.target)} := {self.shown_as(kind, s.value)};"]
        if isinstance(s, If):
            lines = [f"if {self.shown_as('int', s.test)} then", *_indent(self.body(s.body))]
            if len(s.orelse) == 1 and isinstance(s.orelse[0], If):
                first, *more = self.statement(s.orelse[0])
                return [*lines, f"else{first}", *more]
            return [*lines, *(["else", *_indent(self.body(s.orelse))] if s.orelse else []), "end if;"]
        if isinstance(s, For):
            return self.loop(s)
        if isinstance(s, Break):
            return [f"{self.names[GO]} := false;"]
        return [f"result := {self.show(s.value)};"]

    def declare(self, s: Declare) -> list[str]:
        values = [self.shown_as(s.kind, v) for v in s.values]
        name = self.fresh(s.name, (s.kind, s.length))
        if not values:
            return []
        return [f"{name} := {values[0] if s.length is None else '{' + ', '.join(values) + '}'};"]

    def loop(self, s: For) -> list[str]:
        """A loop; one that may end early has a flag, and runs empty from there on."""
        if not s.over:
            return []
        seen, early = dict(self.names), leaves_loop(s.body)
        index = word(s.index)
        while index in self.used or index in self.locals:
            index += "_"
        self.used.add(index)
        self.names[s.index] = index
        begin = [f"{self.fresh(GO, ('int', None))} := true;"] if early else []
        body = self.body(s.body)
        body = [f"if {self.names[GO]} then", *_indent(body), "end if;"] if early else body
        self.used.discard(index)
        self.names = seen
        step = "" if s.over.step == 1 else f"{s.over.step}:"
        return [*begin, f"for {index} in {s.over.start}:{step}{s.over[-1]} loop", *_indent(body), "end for;"]

    def fresh(self, name: str, kind: tuple[str, int | None]) -> str:
        """A name for a variable of C; that of one of the same kind which is seen no more."""
        found = word(name.strip())
        while found in self.used and (self.declared.get(found) != kind or found in self.names.values()):
            found += "_"
        self.used.add(found)
        self.names[name], self.declared[found] = found, kind
        return found

    # Expressions

    def kind(self, e: Expr) -> str:
        if isinstance(e, Num):
            return "long" if isinstance(e.value, int) else "double"
        if isinstance(e, Ref):
            name = self.names.get(e.name, "") if not e.of else ""
            return self.declared[name][0] if name in self.declared else "double" if e.of or e.index else self.bare(e)
        if e.op in _TRUTHS:
            return "int"
        if e.op in TYPES:
            return e.op
        if e.op == "place_of":
            return "long"
        kinds = {self.kind(a) for a in (e.args[1:] if e.op == "?" else e.args)}
        return "double" if "double" in kinds or e.op == "/" else "int" if kinds == {"int"} else "long"

    def bare(self, e: Ref) -> str:
        """The kind of a name that is not declared: the input, or the index of a loop."""
        return "double" if e.name in ("x", "y") else "long"

    def shown_as(self, kind: str, e: Expr) -> str:
        """An expression where a value of this kind is wanted: numbers are no truths in Modelica, nor truths numbers."""
        own = self.kind(e)
        if kind == "int" and own != "int":
            if isinstance(e, Num):
                return str(bool(e.value)).lower()
            if isinstance(e, Op) and e.op == "?":
                test, a, b = (self.shown_as("int", each) for each in e.args)
                return f"if {test} then {a} else {b}"
            return f"{self.show(e, 5)} <> 0"
        if kind != "int" and own == "int":
            return f"if {self.show(e)} then 1 else 0"
        return self.show(e)

    def show(self, e: Expr, rank: int = 0) -> str:
        """An expression, in brackets where it binds less than `rank`."""
        if isinstance(e, Num):
            return str(e.value) if isinstance(e.value, int) else real(e.value)
        if isinstance(e, Ref):
            return self.reference(e)
        text = self.operation(e)
        return f"({text})" if _RANKS.get(e.op, 10) < rank else text

    def reference(self, e: Ref) -> str:
        name = f"{e.of}_{e.name}" if e.of else self.names.get(e.name, word(e.name))
        return name if e.index is None else f"{name}[{self.place(e.index)}]"

    def place(self, e: Expr) -> str:
        """A place in an array, counted from 1."""
        if isinstance(e, Num):
            return str(int(e.value) + 1)
        if isinstance(e, Op) and e.op in ("+", "-") and isinstance(e.args[1], Num):
            more = int(e.args[1].value) * (1 if e.op == "+" else -1) + 1
            left = self.show(e.args[0], 5)
            return left if more == 0 else f"{left} {'+' if more > 0 else '-'} {abs(more)}"
        return f"{self.show(e, 5)} + 1"

    def operation(self, e: Op) -> str:
        op, args = e.op, e.args
        if op in _SIGNS:
            rank, wanted = _RANKS[op], "int" if op in ("&&", "||") else "double"
            return f"{self.operand(wanted, args[0], rank)} {_SIGNS[op]} {self.operand(wanted, args[1], rank + 1)}"
        if op == "neg":
            return f"-{self.show(args[0], 6)}"
        if op == "!":
            return f"not ({self.shown_as('int', args[0])})"
        if op == "?":
            a, b = (self.operand(self.kind(e), v, 1) for v in args[1:])
            return f"if {self.shown_as('int', args[0])} then {a} else {b}"
        if op == "double":
            return f"({self.shown_as('double', args[0])})" if self.kind(args[0]) == "int" else self.show(args[0], 10)
        if op == "long":
            return f"truncated({self.show(args[0])})"
        if op == "pow":
            return f"{self.show(args[0], 10)}^{self.show(args[1], 10)}"
        if op == "place_of":
            at, count = args
            assert isinstance(count, Num)
            return f"min(max({self.show(at)}, 0), {int(count.value) - 1})"
        if op == "sum_of":
            return self.product(args[0], args[1])
        if op not in _FUNCTIONS:
            raise InputError(f"{op} is no function of Modelica; export with --c or --fmu")
        return f"{_FUNCTIONS[op]}({', '.join(self.operand('double', a, 0) for a in args)})"

    def operand(self, kind: str, e: Expr, rank: int) -> str:
        """An expression as a value of a kind, which something around it binds."""
        if (kind == "int") == (self.kind(e) == "int"):
            return self.show(e, rank)
        return f"({self.shown_as(kind, e)})"

    def product(self, first: Expr, second: Expr) -> str:
        assert isinstance(first, Op)
        (start,) = first.args
        assert isinstance(start, Ref)
        assert start.index is not None
        return f"sum_of({word(start.name)}, {self.show(start.index)}, {self.show(second)})"


def _size(length: int | None) -> str:
    return "" if length is None else f"[{length}]"


def _sized(name: str, length: int | None) -> str:
    return f"Real {name}{_size(length)}"


def _indent(lines: list[str]) -> list[str]:
    return [f"  {line}" for line in lines]

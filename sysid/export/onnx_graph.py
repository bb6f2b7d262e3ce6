"""Nodes of an ONNX graph and of the graphs within it: numbers that are known stay numbers, nothing is computed twice.

Every value is a tensor of one dimension, a scalar one of length 1. What hangs on parameters alone is computed in the
outermost graph, once in a run.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

TYPES = {"double": np.float64, "long": np.int64, "int": np.bool_}  # by the kinds of `c_tree`
NAMES = {
    **{"+": "Add", "-": "Sub", "*": "Mul", "/": "Div", "neg": "Neg", "!": "Not", "&&": "And", "||": "Or"},
    **{"<": "Less", "<=": "LessOrEqual", ">": "Greater", ">=": "GreaterOrEqual", "==": "Equal", "?": "Where"},
    **{"min_of": "Min", "max_of": "Max", "fabs": "Abs", "floor": "Floor", "pow": "Pow", "exp": "Exp", "log": "Log"},
    **{"sqrt": "Sqrt", "sin": "Sin", "tanh": "Tanh"},
}
TRUTHS = ("&&", "||", "!", "<", "<=", ">", ">=", "==", "!=")


@dataclass(frozen=True)
class Tensor:
    """A computed value: its name, its kind, and whether it is there before the first sample."""

    name: str
    kind: str


@dataclass(frozen=True)
class Part:
    """One number of a tensor, not yet taken out of it."""

    whole: Tensor
    at: int


Value = float | Tensor | Part  # a float, int or bool is known


@dataclass
class Array:
    """Numbers in a row, of one kind."""

    kind: str
    items: list[Value]

    @classmethod
    def of(cls, whole: Tensor, length: int) -> "Array":
        return cls(whole.kind, [Part(whole, k) for k in range(length)])

    def copy(self) -> "Array":
        return replace(self, items=list(self.items))


@dataclass
class Graph:
    """A graph in the making; `outer` is the one around it."""

    helper: Any  # onnx.helper
    outer: "Graph | None" = None
    nodes: list[Any] = field(default_factory=list)
    initializers: dict[str, np.ndarray] = field(default_factory=dict)
    known: dict[tuple, str] = field(default_factory=dict)  # what is computed, by how
    depths: dict[str, int] = field(default_factory=dict)  # by name: 0 in the outermost graph

    def __post_init__(self) -> None:
        self.depth: int = 0 if self.outer is None else self.outer.depth + 1
        self.top: Graph = self if self.outer is None else self.outer.top

    def fresh(self) -> str:
        """A name that no other value has."""
        name = f"t{len(self.top.depths)}"
        self.top.depths[name] = self.depth
        return name

    def input(self, name: str, kind: str) -> Tensor:
        """What comes into this graph from outside."""
        self.top.depths[name] = self.depth
        return Tensor(name, kind)

    def add(self, op: str, names: Iterable[str], kind: str, **attributes: Any) -> Tensor:
        """The output of a node; of one that is there, if it does the same."""
        names = list(names)
        key = (op, *names, *sorted((k, repr(v)) for k, v in attributes.items()))
        at: Graph | None = self if any(self.top.depths.get(n, 0) for n in names) else self.top
        home, place = at, at
        while place is not None:
            if key in place.known:
                return Tensor(place.known[key], kind)
            place = place.outer
        assert home is not None
        name = home.known[key] = home.fresh()
        home.node(op, names, [name], **attributes)
        return Tensor(name, kind)

    def node(self, op: str, inputs: list[str], outputs: list[str], **attributes: Any) -> None:
        """A node of this graph, named by its output: onnxruntime mixes up nodes without names."""
        name = f"{op}_{outputs[0] if outputs else self.fresh()}"
        self.nodes.append(self.helper.make_node(op, inputs, outputs, name=name, **attributes))

    def constant(self, values: np.ndarray) -> str:
        """Name of an initializer with these values."""
        key = ("constant", values.dtype.str, values.shape, values.tobytes())
        if key not in self.top.known:
            name = self.top.known[key] = self.top.fresh()
            self.top.initializers[name] = values
        return self.top.known[key]

    def name(self, value: Value, kind: str) -> str:
        """Name of a tensor with this value, in this kind."""
        if isinstance(value, (bool, int, float)):
            return self.constant(np.array([value], dtype=TYPES[kind]))
        found = self.taken(value) if isinstance(value, Part) else value
        if found.kind != kind:
            to = int(self.helper.np_dtype_to_tensor_dtype(np.dtype(TYPES[kind])))
            found = self.add("Cast", [found.name], kind, to=to)
        return found.name

    def taken(self, part: Part) -> Tensor:
        """One number out of a tensor."""
        at = self.constant(np.array([part.at], dtype=np.int64))
        return self.add("Gather", [part.whole.name, at], part.whole.kind)

    def row(self, array: Array) -> Tensor:
        """All numbers of an array in one tensor: stretches of another one are taken together."""
        runs: list[tuple[Value, int]] = []
        for item in array.items:
            if isinstance(item, Part) and runs and isinstance(runs[-1][0], Part):
                first, count = runs[-1]
                if first.whole == item.whole and first.at + count == item.at:  # type: ignore[union-attr]
                    runs[-1] = (first, count + 1)
                    continue
            runs.append((item, 1))
        if all(isinstance(item, (bool, int, float)) for item in array.items):
            return Tensor(self.constant(np.array(array.items, dtype=TYPES[array.kind])), array.kind)
        names = [self._run(first, count, array.kind) for first, count in runs]
        return Tensor(names[0], array.kind) if len(names) == 1 else self.add("Concat", names, array.kind, axis=0)

    def _run(self, first: Value, count: int, kind: str) -> str:
        if count == 1 or not isinstance(first, Part):
            return self.name(first, kind)
        ends = [self.constant(np.array([k], dtype=np.int64)) for k in (first.at, first.at + count)]
        return self.add("Slice", [first.whole.name, *ends], first.whole.kind).name

    def operation(self, op: str, args: list[Value]) -> Value:
        """An operator or function of values; of numbers that are known, the number."""
        kinds = [kind_of(a) for a in args]
        if op in KNOWN and all(isinstance(a, (bool, int, float)) for a in args):
            try:
                return KNOWN[op](*args)
            except ZeroDivisionError:
                pass  # as the graph has it: infinite
        if op == "cos":  # which onnxruntime had in single precision alone for years
            return self.operation("sin", [self.operation("+", [args[0], np.pi / 2])])
        if op == "acos":
            return self._arc_cosine(args[0])
        if op in ("&&", "||"):
            for a, b in (args, args[::-1]):
                if isinstance(a, bool):
                    return b if a is (op == "&&") else a
        if op == "!=":
            return self.operation("!", [self.operation("==", args)])
        if op == "?":
            if isinstance(args[0], (bool, int, float)):
                return args[1] if args[0] else args[2]
            kind = wider(kinds[1:])
            if kind == "int":  # onnxruntime chooses no truths
                no = self.operation("!", args[:1])
                sides = [self.operation("&&", [a, b]) for a, b in zip((args[0], no), args[1:], strict=True)]
                return self.operation("||", sides)
            names = [self.name(args[0], "int"), *(self.name(a, kind) for a in args[1:])]
            return self.add("Where", names, kind)
        kind = "int" if op in ("&&", "||", "!") else wider(kinds)
        if kind == "int" and op not in ("&&", "||", "!", "=="):
            kind = "long"
        result = "int" if op in TRUTHS else kind
        if op not in ("+", "-", "*", "neg", "min_of", "max_of", *TRUTHS):
            kind = result = "double"
        return self.add(NAMES[op], [self.name(a, kind) for a in args], result)

    def _arc_cosine(self, w: Value) -> Value:
        """acos w, which onnxruntime has in single precision alone: a polynomial, off by 7e-5, and Newton's steps.

        Abramowitz and Stegun 1964, Handbook of Mathematical Functions, 4.4.45.
        """
        f, positive = self.operation, self.operation(">", [w, 0.0])
        size: Value = f("fabs", [w])
        guess: Value = _ARC[0]
        for c in _ARC[1:]:
            guess = f("+", [f("*", [guess, size]), c])
        guess = f("*", [guess, f("sqrt", [f("-", [1.0, size])])])
        guess = f("?", [positive, guess, f("-", [np.pi, guess])])
        for _ in range(2):
            off, slope = f("-", [f("cos", [guess]), w]), f("max_of", [f("sin", [guess]), 1e-300])
            guess = f("+", [guess, f("/", [off, slope])])
        return guess


_ARC = (-0.0187293, 0.0742610, -0.2121144, 1.5707288)
KNOWN: dict[str, Any] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "neg": lambda a: -a,
    "!": lambda a: not a,
    "&&": lambda a, b: bool(a and b),
    "||": lambda a, b: bool(a or b),
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
    "min_of": lambda a, b: min(a, b),
    "max_of": lambda a, b: max(a, b),
}


def kind_of(value: Value) -> str:
    """The kind of a value."""
    if isinstance(value, Tensor):
        return value.kind
    if isinstance(value, Part):
        return value.whole.kind
    return "int" if isinstance(value, bool) else "long" if isinstance(value, int) else "double"


def wider(kinds: list[str]) -> str:
    """The kind that values of all these are brought to."""
    return "double" if "double" in kinds else "long" if "long" in kinds else "int"

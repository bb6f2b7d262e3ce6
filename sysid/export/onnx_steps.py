"""The tree of a block's C99 as nodes of ONNX: loops that may end early are loops there too, others are written out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from sysid.base.errors import InputError
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
    targets,
)
from sysid.export.onnx_graph import NAMES, TYPES, Array, Graph, Tensor, Value, kind_of

# onnxruntime spends about a microsecond on a node and ten on entering a loop or a branch: small ones are written out.
UNROLLED = 400  # statements of a loop, all passes together
INLINE = 12  # nodes of both branches: then both are computed, and one is chosen
GO, OUT = ("", " go"), ("", " out")  # whether a loop goes on, and what a function returns
Key = tuple[str, str]


@dataclass
class Names:
    """What the names of a body stand for at one place of it, by (struct or "", name)."""

    values: dict[Key, Value | Array] = field(default_factory=dict)
    kinds: dict[Key, str] = field(default_factory=dict)

    def copy(self) -> "Names":
        copies = {k: v.copy() if isinstance(v, Array) else v for k, v in self.values.items()}
        return Names(copies, dict(self.kinds))


@dataclass
class Steps:
    """One body, statement by statement, into a graph."""

    graph: Graph
    names: Names
    tables: Mapping[str, np.ndarray]

    def within(self, graph: Graph) -> "Steps":
        """The same at this place, into a graph within."""
        return Steps(graph, self.names.copy(), self.tables)

    def run(self, body: Body) -> None:
        """All statements."""
        for s in body:
            self.statement(s)

    def statement(self, s: Stmt) -> None:
        if isinstance(s, Declare):
            self.declare(s)
        elif isinstance(s, Set):
            self.set(s.target, self.value(s.value))
        elif isinstance(s, If):
            self.branches(s)
        elif isinstance(s, For):
            if leaves_loop(s.body) or _passes((s,)) > UNROLLED:
                self.loop(s)
                return
            for index in s.over:
                self.names.values["", s.index] = index
                self.run(s.body)
        elif isinstance(s, Break):
            self.names.values[GO] = False
        else:
            self.names.values[OUT] = self.value(s.value)

    def declare(self, s: Declare) -> None:
        key, values = ("", s.name), [self.value(v) for v in s.values]
        self.names.kinds[key] = s.kind
        if s.length is None:
            self.names.values[key] = _as(s.kind, values[0]) if values else TYPES[s.kind](0).item()
        else:
            self.names.values[key] = Array(s.kind, values or [0.0] * s.length)

    def set(self, target: Ref, value: Value) -> None:
        key = (target.of, target.name)
        if target.index is None:
            self.names.values[key] = _as(self.names.kinds[key], value)
            return
        array = cast(Array, self.names.values[key])
        at = self.value(target.index)
        if isinstance(at, int):
            array.items[at] = value
            return
        places = self.graph.constant(np.arange(len(array.items), dtype=np.int64))
        here = self.graph.add("Equal", [places, self.graph.name(at, "long")], "int").name
        new = [here, self.graph.name(value, array.kind), self.graph.row(array).name]
        self.names.values[key] = Array.of(self.graph.add("Where", new, array.kind), len(array.items))

    # Expressions

    def value(self, e: Expr) -> Value:
        """The value of an expression here."""
        if isinstance(e, Num):
            return e.value
        if isinstance(e, Ref):
            return self.read(e)
        if e.op in TYPES:
            return self.cast(e.op, self.value(e.args[0]))
        if e.op == "sum_of":
            return self.product(*e.args)
        if e.op == "place_of":
            at, count = (self.value(a) for a in e.args)
            return self.graph.operation("min_of", [self.graph.operation("max_of", [at, 0]), cast(int, count) - 1])
        if e.op not in (*NAMES, "!=", "cos", "acos"):
            raise InputError(f"{e.op} is no function of ONNX; export with --c or --fmu")
        return self.graph.operation(e.op, [self.value(a) for a in e.args])

    def array(self, name: Key) -> Array:
        found = self.names.values.get(name)
        if found is None:
            table = self.tables[name[1]]
            found = Array.of(Tensor(self.graph.constant(np.asarray(table, dtype=float)), "double"), len(table))
        return cast(Array, found)

    def read(self, e: Ref) -> Value:
        if e.index is None:
            return cast(Value, self.names.values[e.of, e.name])
        array, at = self.array((e.of, e.name)), self.value(e.index)
        if isinstance(at, (int, float)):
            return array.items[int(at)]
        if len(array.items) == 1:
            return array.items[0]
        return self.graph.add("Gather", [self.graph.row(array).name, self.graph.name(at, "long")], array.kind)

    def cast(self, kind: str, value: Value) -> Value:
        if isinstance(value, (bool, int, float)):
            return _as(kind, value)
        if kind_of(value) == kind:
            return value
        return Tensor(self.graph.name(value, kind), kind)

    def product(self, first: Expr, second: Expr, count: Expr) -> Value:
        """sum_of(&a[k], b, n)."""
        assert isinstance(first, Op)
        (start,) = first.args
        assert isinstance(start, Ref) and start.index is not None and isinstance(second, Ref)  # noqa: PT018
        table, weights = self.array(("", start.name)), self.array(("", second.name))
        n, at = cast(int, self.value(count)), self.value(start.index)
        places = self.graph.constant(np.arange(n, dtype=np.int64))
        where = self.graph.operation("+", [Tensor(places, "long"), at])
        chosen = self.graph.add("Gather", [self.graph.row(table).name, self.graph.name(where, "long")], "double")
        terms = self.graph.add("Mul", [chosen.name, self.graph.row(weights).name], "double")
        return self.graph.add("ReduceSum", [terms.name], "double", keepdims=1)

    # Branches and loops

    def branches(self, s: If) -> None:
        test = self.value(s.test)
        if isinstance(test, (bool, int, float)):
            self.run(s.body if test else s.orelse)
            return
        sides = [self.within(Graph(self.graph.helper, self.graph)) for _ in range(2)]
        for side, body in zip(sides, (s.body, s.orelse), strict=True):
            side.run(body)
        before = self.names.values
        changed = [k for k in before if any(side.names.values[k] != before[k] for side in sides)]
        if not changed:
            return
        small = sum(len(side.graph.nodes) for side in sides) <= INLINE
        if small and not any(node.op_type in ("If", "Loop") for side in sides for node in side.graph.nodes):
            self.choose(test, sides, changed)
            return
        kinds = [self.names.kinds[k] for k in changed]
        graphs = {}
        for side, word in zip(sides, ("then_branch", "else_branch"), strict=True):
            outs = [side.out(k) for k in changed]
            graphs[word] = side.closed(
                word, [], [(n, kind, self.length(k)) for n, kind, k in zip(outs, kinds, changed, strict=True)]
            )
        self.put("If", [self.graph.name(test, "int")], changed, **graphs)

    def choose(self, test: Value, sides: list["Steps"], changed: list[Key]) -> None:
        """Both sides computed here, and one chosen."""
        for side in sides:
            self.graph.nodes += side.graph.nodes
            for node in side.graph.nodes:
                self.graph.top.depths.update(dict.fromkeys(node.output, self.graph.depth))
        for key in changed:
            pair = [side.names.values[key] for side in sides]
            if isinstance(pair[0], Array) and isinstance(pair[1], Array):
                items = [
                    a if a == b else self.graph.operation("?", [test, a, b])
                    for a, b in zip(pair[0].items, pair[1].items, strict=True)
                ]
                self.names.values[key] = Array(pair[0].kind, items)
            else:
                chosen = self.graph.operation("?", [test, *cast(list[Value], pair)])
                self.names.values[key] = self.cast(self.names.kinds[key], chosen)

    def loop(self, s: For) -> None:
        inside = targets(s.body)
        carried = [k for k in self.names.values if k in inside]
        outer_go = self.names.values.pop(GO, None)
        graph = Graph(self.graph.helper, self.graph)
        body = self.within(graph)
        passes, goes = graph.input(graph.fresh(), "long"), graph.input(graph.fresh(), "int")
        heads: list[tuple[str, str, int | None]] = [(passes.name, "long", None), (goes.name, "int", None)]
        firsts = [self.out(k, copied=False) for k in carried]
        for key in carried:
            came = graph.input(graph.fresh(), self.names.kinds[key])
            heads.append((came.name, came.kind, self.length(key)))
            n = self.length(key)
            body.names.values[key] = Array.of(came, n) if isinstance(self.names.values[key], Array) else came
        one = graph.constant(np.array([1], dtype=np.int64))
        count = graph.add("Reshape", [passes.name, one], "long")
        step = graph.operation("*", [count, s.over.step])
        body.names.values["", s.index] = graph.operation("+", [step, s.over.start]) if s.over.start else step
        body.names.values[GO], body.names.kinds[GO] = True, "int"
        body.run(s.body)
        ends = [body.out(k) for k in (GO, *carried)]
        empty = graph.constant(np.array([], dtype=np.int64))
        ends[0] = graph.add("Reshape", [ends[0], empty], "int").name
        tails: list[tuple[str, str, int | None]] = [(ends[0], "int", None)]
        tails += [(n, self.names.kinds[k], self.length(k)) for n, k in zip(ends[1:], carried, strict=True)]
        trips = graph.constant(np.array(len(s.over), dtype=np.int64))
        self.put("Loop", [trips, "", *firsts], carried, body=body.closed("body", heads, tails))
        if outer_go is not None:
            self.names.values[GO] = outer_go

    def length(self, key: Key) -> int:
        held = self.names.values.get(key)
        return len(held.items) if isinstance(held, Array) else 1

    def out(self, key: Key, copied: bool = True) -> str:
        """Name of a tensor with what a name stands for at the end of this graph, which has to be made in it."""
        held = self.names.values[key]
        name = self.graph.row(held).name if isinstance(held, Array) else self.graph.name(held, self.names.kinds[key])
        return self.moved(name) if copied else name

    def moved(self, name: str) -> str:
        """The same under a name of this graph and of no other output."""
        copy = self.graph.fresh()
        self.graph.node("Identity", [name], [copy])
        return copy

    def closed(self, word: str, inputs: list[Any], outputs: list[Any]) -> Any:
        """The graph as ONNX has it; inputs and outputs are (name, kind, length), a scalar of no length is None."""
        helper = self.graph.helper

        def info(of: tuple[str, str, int | None]) -> Any:
            name, kind, length = of
            kind_number = helper.np_dtype_to_tensor_dtype(np.dtype(TYPES[kind]))
            return helper.make_tensor_value_info(name, kind_number, [] if length is None else [length])

        return helper.make_graph(self.graph.nodes, word, [info(i) for i in inputs], [info(o) for o in outputs])

    def put(self, op: str, inputs: list[str], results: list[Key], **attributes: Any) -> None:
        """A node with graphs, whose outputs are what these names stand for from here on."""
        names = [self.graph.fresh() for _ in results]
        self.graph.node(op, inputs, names, **attributes)
        for key, name in zip(results, names, strict=True):
            whole = Tensor(name, self.names.kinds[key])
            held = self.names.values[key]
            self.names.values[key] = Array.of(whole, len(held.items)) if isinstance(held, Array) else whole


def _passes(body: Body) -> int:
    """Statements with all passes of their loops; one that takes a value to another place needs no node."""
    total = 0
    for s in body:
        total += not (isinstance(s, Set) and isinstance(s.value, (Num, Ref)))
        if isinstance(s, If):
            total += _passes(s.body + s.orelse)
        elif isinstance(s, For):
            total += len(s.over) * _passes(s.body)
    return total


def _as(kind: str, value: Value) -> Value:
    """A known number in a kind; a tensor stays as it is."""
    if not isinstance(value, (bool, int, float)):
        return value
    return float(value) if kind == "double" else int(value) if kind == "long" else bool(value)

"""A fit as an ONNX graph in double precision: a Scan over the samples, whose body is the model's step.

Inputs u (N, nu) and state (S,), outputs y (N, ny) and next_state (S,). The parameters are initializers under the names
of `Fit.parameters`.
"""

import os
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import write_bytes
from sysid.export import closed_form
from sysid.export.c_structs import Structs
from sysid.export.c_tree import tree
from sysid.export.onnx_graph import Array, Graph, Tensor, Value
from sysid.export.onnx_steps import OUT, Names, Steps
from sysid.export.program import AnyFit, Offset, c_program
from sysid.model.wiring import Unit, whole

OPSET, IR = 17, 8  # from onnx 1.12 and onnxruntime 1.12 of 2022 on; nothing newer is used


@checked
def write(fit: AnyFit, path: str | os.PathLike, **scale: Offset) -> Path:
    """Write `model` to a file, complete or not at all."""
    return write_bytes(path, model(fit, Path(path).stem, **scale).SerializeToString())


@checked
def model(fit: AnyFit, name: str = "model", u_offset: Offset = None, y_offset: Offset = None) -> Any:
    """The fit's free run as an `onnx.ModelProto`, which `onnx.checker` has passed.

    A state of zeros, which is what a runtime takes if none is given, begins a new run: filters and speeds from rest,
    positions and backlash at the fit's initial values, as in `Fit.simulate(u)`. With the state that came out before, a
    run goes on. It takes and gives the levels of raw records: u_offset (nu,) and y_offset (ny,) are what was removed
    from the estimation data, by default as the fit knows it. Raises InputError for a block without a formula, and
    where the package onnx is missing.
    """
    onnx = package()
    return _Model(onnx, fit, name, u_offset, y_offset).proto()


def package() -> ModuleType:
    """The package onnx.

    Raises InputError, which names the extra, where it is missing.
    """
    try:
        import onnx
    except ImportError:
        raise InputError("ONNX needs the package onnx, which is not installed: pip install 'qpal[onnx]'") from None
    return cast(ModuleType, onnx)


class _Model:
    """The graph of one fit."""

    def __init__(self, onnx: ModuleType, fit: AnyFit, name: str, u_offset: Offset, y_offset: Offset) -> None:
        self.onnx, self.fit, self.name = onnx, fit, name
        self.program = c_program(fit, u_offset, y_offset)
        self.structs = Structs(fit, name, self.program)
        self.form = closed_form.text(fit, u_offset=u_offset, y_offset=y_offset)
        self.top = Graph(onnx.helper)
        values = [v for u in self.structs.units for v in self.structs.parameters(u)] + [*self.structs.offsets()]
        self.parameters = {v.name: v.start for v in values}
        self.states = ["started", *(v.name for unit in self.structs.units for v in self.structs.states(unit))]

    def proto(self) -> Any:
        """The whole model."""
        helper, n_in, n_out = self.onnx.helper, self.structs.n_in, self.structs.n_out
        before = self.begun()
        ids = [(unit, key) for unit in self.structs.units for key in before[unit.name].values if key[0] == "s"]
        body = Steps(Graph(helper, self.top), Names(), {})
        graph, inputs, firsts, now = body.graph, [], [], {}
        for unit in self.structs.units:
            now[unit.name] = before[unit.name].copy()
        for unit, key in ids:
            firsts.append(self.top.row(_array(before[unit.name].values[key])).name)
            came, n = graph.input(graph.fresh(), "double"), len(_array(now[unit.name].values[key]).items)
            inputs.append((came.name, "double", n))
            held = now[unit.name].values[key]
            now[unit.name].values[key] = Array.of(came, n) if isinstance(held, Array) else came
        sample = graph.input(graph.fresh(), "double")
        inputs.append((sample.name, "double", n_in))
        y = self.sample(graph, now, Array.of(sample, n_in).items)
        outputs = []
        for unit, key in ids:
            row = _array(now[unit.name].values[key])
            outputs.append((body.moved(graph.row(row).name), "double", len(row.items)))
        outputs.append((body.moved(graph.row(Array("double", y)).name), "double", n_out))
        lasts = [graph.fresh() for _ in ids]
        scan = {"body": body.closed("one_sample", inputs, outputs), "num_scan_inputs": 1}
        self.top.node("Scan", [*firsts, "u"], [*lasts, "y"], **scan)
        started = self.top.constant(np.ones(1))
        self.top.node("Concat", [started, *lasts], ["next_state"], axis=0)
        return self.closed()

    def begun(self) -> dict[str, Names]:
        """What the names of each unit stand for before the first sample: the given state, or a new run."""
        state = Array.of(self.top.input("state", "double"), len(self.states))
        new = self.top.operation("==", [state.items[0], 0.0])
        found, place = {}, 1
        for unit in self.structs.units:
            code, names = self.program.codes[unit.name], self.own_parameters(unit)
            given: dict[tuple[str, str], list[Value]] = {}
            for field, length in code.states.items():
                given["s", field] = state.items[place : place + (length or 1)]
                place += length or 1
                names.values["s", field] = Array("double", [0.0] * length) if length else 0.0
                names.kinds["s", field] = "double"
            Steps(self.top, names, {}).run(tree(code.begin))
            for key, items in given.items():
                first = _array(names.values[key]).items
                mixed = [
                    b if a == 0.0 else self.top.operation("?", [new, a, b]) for a, b in zip(first, items, strict=True)
                ]
                names.values[key] = Array("double", mixed) if isinstance(names.values[key], Array) else mixed[0]
            found[unit.name] = names
        return found

    def own_parameters(self, unit: Unit) -> Names:
        """The fields of a unit's struct, each number an initializer."""
        names, own = Names(), {v.place: v.name for v in self.structs.parameters(unit)}
        for field, at in self.program.codes[unit.name].fields.items():
            each = [Tensor(own[k], "double") for k in ((at,) if isinstance(at, int) else at)]
            names.values["p", field] = each[0] if isinstance(at, int) else Array("double", [*each])
        return names

    def sample(self, graph: Graph, now: dict[str, Names], signals: list[Value]) -> list[Value]:
        """One sample: values of all outputs; `now` moves on."""
        signals = self.offset(graph, "-", "u_offset", signals)
        return self.offset(graph, "+", "y_offset", self.chain(graph, now, signals))

    def offset(self, graph: Graph, sign: str, field: str, signals: list[Value]) -> list[Value]:
        """Signals with their offsets taken off or put on."""
        names = [v.name for v in self.structs.offsets() if v.name.startswith(field)]
        return [graph.operation(sign, [s, Tensor(n, "double")]) for s, n in zip(signals, names, strict=True)]

    def chain(self, graph: Graph, now: dict[str, Names], signals: list[Value]) -> list[Value]:
        """What comes out of the last block."""
        for layer in self.program.layers:
            alone = whole(layer)
            if alone is not None:
                signals = self.unit(graph, alone, now, signals)
                continue
            rows = [[self.unit(graph, unit, now, [signals[i]])[0] for unit, i in row] for row in layer]
            signals = [_sum(graph, row) for row in rows]
        return signals

    def unit(self, graph: Graph, unit: Unit, now: dict[str, Names], signals: list[Value]) -> list[Value]:
        """What comes out of one unit."""
        code, names = self.program.codes[unit.name], now[unit.name].copy()
        kept = set(names.values)
        one = code.channels == (1, 1)
        names.values["", "x"] = signals[0] if one else Array("double", signals)
        names.values[OUT], names.kinds[OUT] = 0.0, "double"
        if not one:
            names.values["", "y"] = Array("double", [0.0] * code.channels[1])
        steps = Steps(graph, names, code.tables)
        steps.run(tree(code.body))
        now[unit.name] = Names({k: names.values[k] for k in kept}, names.kinds)
        return [steps.names.values[OUT]] if one else _array(names.values["", "y"]).items  # type: ignore[list-item]

    def closed(self) -> Any:
        """The graph with its ends, parameters and what it says of itself; checked."""
        onnx, helper = self.onnx, self.onnx.helper
        real, S = onnx.TensorProto.DOUBLE, len(self.states)
        ends = {"u": ["N", self.structs.n_in], "state": [S], "y": ["N", self.structs.n_out], "next_state": [S]}
        infos = {name: helper.make_tensor_value_info(name, real, shape) for name, shape in ends.items()}
        numbers = {name: np.array([value]) for name, value in self.parameters.items()} | self.top.initializers
        graph = helper.make_graph(
            self.top.nodes,
            self.name,
            [infos["u"], infos["state"]],
            [infos["y"], infos["next_state"]],
            [onnx.numpy_helper.from_array(v, k) for k, v in (numbers | {"state": np.zeros(S)}).items()],
        )
        made = helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR,
            producer_name="qpal",
            doc_string=self.form,
        )
        said = {"Ts": repr(self.fit.Ts), "state": " ".join(self.states)}
        said |= {"u_unit": self.structs.u_unit, "y_unit": self.structs.y_unit}
        helper.set_model_props(made, said)
        onnx.checker.check_model(made, full_check=True)
        return made


def _array(value: Value | Array) -> Array:
    return value if isinstance(value, Array) else Array("double", [value])


def _sum(graph: Graph, terms: list[Value]) -> Value:
    total = terms[0]
    for term in terms[1:]:
        total = graph.operation("+", [total, term])
    return total

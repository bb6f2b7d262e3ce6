"""The ONNX graph of every structure and block in onnxruntime, beside the fit's own run; its parameters by name."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from exported import AT_REST, FITS, changed, excitation, made, structure_fit, with_values

from sysid import InputError
from sysid.blocks import Channels, Delay, StateSpace, TransferFunction
from sysid.export import c as export_c
from sysid.export import onnx as export_onnx
from sysid.export.c_tree import tree
from sysid.export.onnx_graph import Array, Graph, Part, Tensor
from sysid.model.chain import Chain

onnx = pytest.importorskip("onnx", reason="onnx is in the onnx extra")
runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is in the test extra")

CASES = {**{k: v for k, v in BLOCKS.items() if k != "custom"}, **VARIANTS, **MOVING}
# Share of the output's range, over 10,000 samples: measured 7e-16 at most, of a linkage that is summed up in another
# order; 0 of 12 of the 18 structures.
DOUBLE = 5e-15


class Session:
    """The model in onnxruntime, from its file's bytes."""

    def __init__(self, fit, values=None, **scale):
        self.proto = export_onnx.model(fit, **scale)
        for initializer in self.proto.graph.initializer:
            if initializer.name in (values or {}):
                new = np.array([values[initializer.name]])
                initializer.CopyFrom(onnx.numpy_helper.from_array(new, initializer.name))
        options = runtime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        providers = ["CPUExecutionProvider"]
        self.session = runtime.InferenceSession(self.proto.SerializeToString(), options, providers=providers)

    def run(self, u, state=None):
        """y, of one channel as (N,), and the state at the end."""
        given = {"u": np.asarray(u, dtype=float).reshape(len(u), -1)}
        y, last = self.session.run(None, given if state is None else {**given, "state": state})
        return (y[:, 0] if y.shape[1] == 1 else y), last


def agrees(y, expected):
    assert np.ptp(expected) > 0.0
    assert np.abs(y - expected).max() <= DOUBLE * np.ptp(expected)


@pytest.fixture(scope="module", params=FITS)
def case(request):
    fit, u = structure_fit(request.param)
    return fit, u, Session(fit)


def test_a_run_of_every_structure_is_that_of_the_fit_in_one_part_or_in_two(case):
    fit, u, session = case
    u = u(1500)
    y, last = session.run(u)
    agrees(y, fit.simulate(u))
    first, state = session.run(u[:7])
    second, end = session.run(u[7:], state)
    np.testing.assert_array_equal(np.concatenate([first, second]), y)
    np.testing.assert_array_equal(end, last)


@pytest.mark.nightly
def test_ten_thousand_samples_are_those_of_the_fit(case):
    fit, u, session = case
    u = u(10_000)
    agrees(session.run(u)[0], fit.simulate(u))


def test_a_changed_initializer_gives_the_model_with_that_parameter(case):
    """All that a run for an input alone reads, by the names of `Fit.parameters`."""
    fit, u, session = case
    u, rng = u(1500), np.random.default_rng(1)
    source = export_c.written_source(fit, "model")
    names = {initializer.name for initializer in session.proto.graph.initializer}
    assert {p.name for p in source.parameters} <= names
    own = {p.name.removeprefix("network.") for p in source.parameters if p.place is not None}
    assert own <= {p.name for p in fit.parameters}
    values = {
        p.name: p.start if p.name.endswith(AT_REST) or p.place is None else changed(p, rng.uniform(1.001, 1.02))
        for p in source.parameters
    }
    expected = with_values(fit, source, list(values.values())).simulate(u)
    assert np.any(expected != fit.simulate(u))
    agrees(Session(fit, values).run(u)[0], expected)


@pytest.mark.parametrize("name", sorted(CASES))
def test_every_block_agrees_with_its_run_at_the_levels_of_the_record(name):
    block, theta = CASES[name]
    fit = made(Chain((block,)), theta)
    n_in, n_out = fit.model.channels
    fit = replace(fit, u_offset=0.5 * np.arange(1, n_in + 1), y_offset=-3.0 * np.arange(1, n_out + 1))
    u = excitation(n_in, 200)
    levels = u + (fit.u_offset if n_in > 1 else fit.u_offset[0])
    agrees(Session(fit).run(levels)[0], fit.simulate(u) + (fit.y_offset if n_out > 1 else fit.y_offset[0]))


def test_several_channels_through_several_blocks():
    first = Channels(maps=(BLOCKS["saturation"][0], BLOCKS["polynomial"][0]), role="input")
    matrix = BLOCKS["transfer_matrix"]
    theta = np.concatenate([BLOCKS["saturation"][1], BLOCKS["polynomial"][1], matrix[1]])
    fit, u = made(Chain((first, matrix[0])), theta), excitation(2, 300)
    agrees(Session(fit).run(u)[0], fit.simulate(u))
    block = StateSpace(nx=2, nu=2, ny=2, units=1, role="linear")
    theta = block.vary(block.start(u), np.random.default_rng(0))
    fit = made(Chain((block,)), theta + 0.05)
    agrees(Session(fit).run(u)[0], fit.simulate(u))


def test_a_row_of_parts_takes_together_only_what_stands_together():
    graph = Graph(onnx.helper)
    whole = Tensor("w", "double")
    graph.row(Array("double", [Part(whole, 0), Part(whole, 1), Part(whole, 3), 2.0]))
    assert [node.op_type for node in graph.nodes] == ["Slice", "Gather", "Concat"]


def test_a_very_long_filter_is_a_loop_and_its_memory_is_moved_at_once():
    block, u = TransferFunction(450, 0, 0, role="slow"), excitation(N=460)
    theta = np.random.default_rng(0).normal(size=block.n_parameters)
    fit = made(Chain((block,)), theta)
    session = Session(fit)
    agrees(session.run(u)[0], fit.simulate(u))
    (scan,) = (node for node in session.proto.graph.node if node.op_type == "Scan")
    kinds = [node.op_type for node in scan.attribute[0].g.node]
    assert kinds.count("Loop") == 1
    assert len(kinds) < 20


@pytest.mark.parametrize("size", [(3, 100), (40, 0), (2, 41)])
def test_large_sums_are_loops_and_long_memories_few_nodes(size):
    """A state space of many units, a filter of many coefficients, and a long delay."""
    nx, units = size
    u = excitation(N=200)
    if nx == 40:
        block = TransferFunction(40, 1, 30, role="slow")
        theta = np.where(np.arange(block.n_parameters) < 40, 1.0, 0.0)
        theta[40] = -0.5
    elif units == 41:
        block, theta = Delay(role="line"), np.array([40.6])
    else:
        block = StateSpace(nx=nx, units=units, role="linear")
        drawn = np.random.default_rng(0)
        theta = block.vary(block.start(u), drawn)
        theta = theta + 0.01 * drawn.normal(size=len(theta))
    fit = made(Chain((block,)), theta)
    session = Session(fit)
    agrees(session.run(u)[0], fit.simulate(u))
    (scan,) = (node for node in session.proto.graph.node if node.op_type == "Scan")
    nodes = scan.attribute[0].g.node
    assert any(node.op_type == "Loop" for node in nodes) == (units == 100)
    assert len(nodes) < (1000 if units == 100 else 300)


def test_a_network_that_diverges_stays_infinite():
    fit, u = structure_fit("nlarx")
    theta = fit.theta.copy()
    theta[1] = 1.5  # dy/dy(t-1)
    wild = replace(fit, theta=theta)
    u = u(500)
    expected = wild.simulate(u)
    assert np.isinf(expected[-1])
    n = int(np.argmax(np.isinf(expected)))
    y, _ = Session(wild).run(u)
    np.testing.assert_allclose(y[:n], expected[:n], rtol=1e-9)
    assert np.all(np.isinf(y[n:]))


def test_what_the_model_says_of_itself():
    fit, _ = structure_fit("hammerstein")
    proto = export_onnx.model(fit, "knee")
    said = {p.key: p.value for p in proto.metadata_props}
    assert (float(said["Ts"]), said["state"]) == (0.1, "started linear.past[0] linear.past[1]")
    assert (proto.graph.name, proto.producer_name) == ("knee", "qpal")
    assert "hammerstein, one sample every 0.1 s" in proto.doc_string
    ends = [(e.name, [d.dim_param or d.dim_value for d in e.type.tensor_type.shape.dim]) for e in proto.graph.input]
    assert ends == [("u", ["N", 1]), ("state", [3])]


def test_without_the_package_a_sentence_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"which is not installed: pip install 'qpal\[onnx\]'"):
        export_onnx.model(structure_fit("hammerstein")[0])


def test_a_block_without_a_formula_is_refused():
    block, theta = BLOCKS["custom"]
    fit = made(Chain((block,)), theta)
    with pytest.raises(InputError, match="has no formula to write as C; fit a piecewise linear map"):
        export_onnx.model(fit)


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("while (1) { }", "( 1 ) { }"),
        ("double a = 1.0; const char c = 0;", "1.0 ; const char c = 0 ;"),
        ("x << 2;", "x < < 2 ;"),
        ("return x % 2.0;", "return x % 2.0 ;"),
        ("x = $;", "x = $ ;"),
        ("return x", "return x"),
    ],
)
def test_what_is_beyond_the_language_of_blocks_is_refused(text, near):
    said = f"'{near}' of the exported C cannot be written in this language; export with --c or --fmu"
    with pytest.raises(InputError, match=re.escape(said)):
        tree(text)

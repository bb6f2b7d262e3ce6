"""Exported models and the closed form against `Fit.simulate`, sample by sample, for every structure with every map."""

import math
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS, STRUCTURES, VARIANTS
from exported import agrees, c_run, excitation, made, python_run

from sysid import InputError, structures
from sysid.block import step
from sysid.block.block import StaticBlock
from sysid.block.writing import Writer
from sysid.blocks import STATIC, TABLE, Channels, Custom, Delay, TransferFunction, TransferMatrix
from sysid.blocks.offset import is_offset
from sysid.export import c as export_c
from sysid.export import closed_form
from sysid.export import python as export_python
from sysid.model.chain import Chain
from sysid.model.recipes import LinearOrders
from sysid.model.wiring import Unit, written

LINEAR = np.array([0.2, 0.12, -1.2, 0.5])  # nb 2, nf 2
MAPS = {**{k: v for k, v in BLOCKS.items() if k in STATIC}, **VARIANTS}
COMPOSED = (Channels, TransferMatrix)  # taken apart into the blocks that they are made of
# Where each structure of filters and maps has its maps.
ON_MAPS = {
    name: tuple(b.role for b in recipe.model().blocks if isinstance(b, StaticBlock) and not is_offset(b))
    for name, recipe in STRUCTURES.items()
    if isinstance(recipe, LinearOrders) and isinstance(recipe.model(), Chain)
}


def fitted(structure, maps, nk):
    """A structure with the cases' maps and numbers; every initial state of the estimation record away from rest."""
    options = dict(zip(ON_MAPS[structure], (MAPS[m][0] for m in maps), strict=False))
    chain = getattr(structures, structure)(2, 2, nk, **options)
    values = iter([MAPS[m][1] for m in maps])
    theta = []
    for b in chain.blocks:
        if is_offset(b):
            theta.append(np.array([0.3]))
        elif isinstance(b, StaticBlock):
            theta.append(next(values))
        else:
            theta.append(np.concatenate([LINEAR, np.full(b.n_parameters - 4, 0.7)]))
    return made(chain, np.concatenate(theta))


# Every map alone in each of its places, and every map before another one; delays 0 to 3.
CASES = [
    (structure, chosen, k % 4)
    for structure, places in ON_MAPS.items()
    for k, chosen in enumerate(
        zip(*([*sorted(MAPS), *sorted(MAPS)][i : i + len(MAPS)] for i in range(len(places))), strict=True)
        if places
        else [()] * 4
    )
]
IDS = ["-".join([s, *m, f"nk{k}"]) for s, m, k in CASES]


@pytest.mark.parametrize(("structure", "maps", "nk"), CASES, ids=IDS)
def test_python_file_agrees_with_simulate(structure, maps, nk):
    fit, u = fitted(structure, maps, nk), excitation()
    agrees(python_run(fit, u), fit.simulate(u))


@pytest.mark.parametrize(("structure", "maps", "nk"), CASES, ids=IDS)
def test_c_file_agrees_with_simulate(tmp_path, structure, maps, nk):
    fit, u = fitted(structure, maps, nk), excitation()
    agrees(c_run(fit, u, tmp_path), fit.simulate(u))


def mimo():
    first, last = (
        Channels(maps=(BLOCKS["saturation"][0], BLOCKS["polynomial"][0]), role="input"),
        BLOCKS["transfer_matrix"],
    )
    chain = Chain((first, last[0]))
    return made(chain, np.concatenate([BLOCKS["saturation"][1], BLOCKS["polynomial"][1], last[1]]))


def test_several_inputs_and_outputs(tmp_path):
    fit, u = mimo(), excitation(2)
    y = fit.simulate(u)
    assert y.shape == (400, 2)
    agrees(python_run(fit, u), y)
    agrees(c_run(fit, u, tmp_path, "two_by_two"), y)


def test_integrator_and_long_delay_do_not_drift_apart(tmp_path):
    """20,000 samples through a double pole near one: rounding adds up, and adds up alike."""
    fit = made(
        Chain((TransferFunction(1, 2, 25, role="linear"),)),
        np.concatenate([[1e-3], np.poly([1.0, 0.999])[1:], np.zeros(25)]),
    )
    u = excitation(N=20000)
    agrees(c_run(fit, u, tmp_path), fit.simulate(u))
    agrees(python_run(fit, u), fit.simulate(u))


def test_offsets_bring_the_rig_s_own_scale_back(tmp_path):
    fit, u = fitted("hammerstein_wiener", ("saturation", "polynomial"), 1), excitation()
    expected = fit.simulate(u - 5.0) - 40.0
    for y in (
        python_run(fit, u, u_offset=5.0, y_offset=-40.0),
        c_run(fit, u, tmp_path, u_offset=5.0, y_offset=-40.0),
    ):
        agrees(y, expected)


def test_the_python_file_is_a_program(tmp_path):
    fit, u = mimo(), excitation(2, 20)
    file = export_python.write(fit, tmp_path / "exported.py")
    text = "\n".join(f"{a!r} {b!r}" for a, b in u.tolist())
    done = subprocess.run([sys.executable, "-I", file], input=text, capture_output=True, text=True, check=True)
    agrees(np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()]), fit.simulate(u))


def test_extreme_levels_do_not_overflow(tmp_path):
    """A sigmoid's exponential leaves the range of doubles long before an input does."""
    fit = fitted("hammerstein", ("sigmoid_network",), 1)
    u = np.array([1e4, -1e4, 0.0, 1e5, -1e5])
    with np.errstate(over="ignore"):
        expected = fit.simulate(u)
    agrees(python_run(fit, u), expected)
    agrees(c_run(fit, u, tmp_path), expected)


def evaluated(lines, x, y):
    """What a person gets who types the formulas of one map into a calculation, at one value of x."""
    space = {"min": min, "max": max, **vars(math), **vars(step)}  # what a step may call
    joined = re.sub(r"\n  \+", " +", "\n".join(lines))
    for line in joined.split("\n"):
        formula, _, where = line.partition("   where ")
        left, _, right = formula.partition(" = ")
        assert left == y
        if not where or eval(where, space, {"x": x}):
            return eval(right.replace("^", "**"), space, {"x": x})
    raise AssertionError(f"no piece for {x}")


@pytest.mark.parametrize("name", [*sorted(MAPS), "quantiser", "travel_map"])
def test_formula_of_a_map_evaluates_to_the_map(name):
    block, theta = {**BLOCKS, **MAPS}[name]
    lines = block.equations(theta, Writer("x", "w", None))
    x = np.concatenate([np.linspace(-3, 3, 61), theta[np.abs(theta) < 3]])
    expected = block.propagate(theta, x, np.empty((len(x), 0)), 0)
    np.testing.assert_allclose([evaluated(lines, v, "w") for v in x.tolist()], expected, rtol=0, atol=1e-11)


def test_formula_of_a_filter_is_its_recursion():
    block, theta = TransferFunction(2, 3, 2), np.array([0.8, -0.5, -1.7, 1.0, -0.21, 0, 0, 0])
    first = block.equations(theta, Writer("w", "x", None))[0]
    left, _, right = first.partition(" = ")
    assert left == "x(t)"
    u = excitation(N=50)
    past = {"x": np.zeros(60), "w": np.concatenate([np.zeros(10), u])}  # ten samples at rest before the record
    for t in range(50):
        space = {k: (lambda i, v=v: v[10 + i]) for k, v in past.items()}
        past["x"][10 + t] = eval(right, {**space, "t": t})
    agrees(past["x"][10:], made(Chain((block,)), theta).simulate(u))


def test_the_whole_text_names_every_signal_in_order():
    text = closed_form.text(fitted("hammerstein_wiener", ("saturation", "polynomial"), 1))
    assert "w = min(max(u, (-1.1)), 1.3)" in text
    assert "x(t) = 0.2*w(t-1) + 0.12*w(t-2) + 1.2*x(t-1) - 0.5*x(t-2)" in text
    assert "y = 0.3*x^3 - 0.2*x^2 + 1.1*x + 0.4" in text
    assert "poles 0.6 +- 0.374166i" in text
    many = closed_form.text(mimo())
    assert "w2 = 0.3*u2^3" in many
    assert "y1 = y1_w1 + y1_w2" in many


@pytest.mark.parametrize("way", ["equations", "c", "python"])
def test_every_registered_block_can_be_written(way):
    units = [Unit(name, *BLOCKS[name]) for name, made in TABLE.items() if made not in (*COMPOSED, Custom)]
    for unit in units:
        written(unit, way)(unit.theta, *([Writer("x", "y", 6)] if way == "equations" else []))


class Own(Delay):
    """A block with a memory that somebody else has made, with a run of its own."""

    def propagate(self, theta, x, J, q):
        return x


def test_what_cannot_be_written_is_refused_in_a_sentence():
    block, theta = BLOCKS["custom"]
    own = made(Chain((block, TransferFunction(1, 1, 1, role="linear"))), np.concatenate([theta, [0.5, -0.5, 0.0]]))
    for write in (closed_form.text, export_c.source, export_python.source):
        with pytest.raises(InputError, match="Custom block, which has no formula"):
            write(own)
        with pytest.raises(InputError, match="Own block, which has no formula to write"):
            write(made(Chain((Own(),)), [1.3]))
    good = fitted("output_error", (), 1)
    with pytest.raises(InputError, match="not an identifier"):
        export_c.source(good, "2 legs")
    with pytest.raises(InputError, match="u_offset"):
        export_python.source(good, u_offset=np.zeros(3))
    with pytest.raises(InputError, match="not finite"):
        export_c.source(made(good.model, np.full(len(good.theta), np.nan)))


def test_a_role_of_the_user_s_own_becomes_an_identifier(tmp_path):
    chain = structures.output_error(2, 2, 1)
    odd = Chain((replace(chain.blocks[0], role="lift arm / 2"),))
    fit, u = made(odd, np.concatenate([LINEAR, np.zeros(2)])), excitation()
    agrees(c_run(fit, u, tmp_path), fit.simulate(u))
    agrees(python_run(fit, u), fit.simulate(u))


@pytest.mark.parametrize("name", ["chain\ropen('/tmp/x','w')\r#", "a\nb", "*/ int x; /*", "", "a\u2028b"])
def test_names_that_could_leave_a_comment_of_the_exported_code_are_refused(name):
    """A file that somebody else saved is loaded by the same constructor."""
    block = Delay(role="late")
    with pytest.raises(InputError, match="give letters, digits"):
        Chain((block,), structure=name)
    with pytest.raises(InputError, match="give letters, digits"):
        Chain((Delay(role=name),))

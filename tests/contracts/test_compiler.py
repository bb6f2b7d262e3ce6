"""What is derived from a step, against plain Python, differences and the exported files; what it refuses; its cache."""

import importlib
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from exported import agrees, c_run, made, python_run
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from sysid.block.compiler import kernel
from sysid.block.compiler.recursion import Map, Recursion, Written
from sysid.block.compiler.subset import read
from sysid.block.step import Input
from sysid.blocks import CoastingPlay, Dynamic, Motor, dynamic
from sysid.model.chain import Chain

CASES = {k: v for k, v in {**BLOCKS, **MOVING, **VARIANTS}.items() if isinstance(v[0], Written)}


def plainly(block, theta, x):
    """The block's own functions as they stand in its file, run by Python sample by sample."""
    params, rows = block.numbers(theta)
    p, s, y = SimpleNamespace(**params, **rows), SimpleNamespace(), []
    for name in block.program().states:
        setattr(s, name, 0.0)

    def call(name, *args):
        f = block.functions[name]
        return f(*args, block) if f.__code__.co_argcount > len(args) else f(*args)

    for t in range(len(x)):
        now = Input.at(x, t)
        if "value" in block.functions:
            y.append(call("value", now, p))
            continue
        if t == 0 and "begin" in block.functions:
            call("begin", s, now, p)
        y.append(call("step", s, now, p))
    return np.array(y)


@pytest.mark.parametrize("name", sorted(k for k, v in CASES.items() if not isinstance(v[0], Dynamic)))
def test_the_compiled_run_is_the_functions_own(name):
    block, theta = CASES[name]
    rng = np.random.default_rng(4)
    x = np.repeat(rng.uniform(-2, 2, 50), 4) + 0.2 * rng.normal(size=200)
    x = np.cumsum(x) * 0.2 if isinstance(block, CoastingPlay) else x
    y = block.propagate(theta, x, np.empty((200, 0)), 0)
    np.testing.assert_allclose(y, plainly(block, theta, x.tolist()), rtol=0, atol=1e-12 * max(1.0, np.abs(y).max()))


@pytest.mark.parametrize("name", sorted(k for k, v in CASES.items() if isinstance(v[0], (Recursion, Map))))
def test_no_column_beside_its_own_is_touched_and_the_output_is_the_same_without(name):
    block, theta = CASES[name]
    rng = np.random.default_rng(5)
    x, q, p = rng.uniform(-2, 2, 80), 3, len(theta)
    for q in (0, 3):
        J = rng.normal(size=(80, q + p + 2))
        beside = J[:, q + p :].copy()
        y = block.propagate(theta, x.copy(), J, q)
        np.testing.assert_array_equal(J[:, q + p :], beside)
        np.testing.assert_array_equal(y, block.propagate(theta, x.copy(), np.empty((80, 0)), 0))


# Every construct that a step may use, in one that no differences are afraid of away from its switches.
EVERYTHING = '''
LIMIT = 3.0
HALF = 0.5


def begin(s, x, p):
    s.a = x * p.gain
    s.n = 1


def squash(v, p):
    """A helper with an early return."""
    if v > LIMIT:
        return LIMIT + tanh(v - LIMIT)
    elif -v > LIMIT:
        return -LIMIT
    return v


def both(u, v):
    return u + v, u * v


def move(s, by):
    s.b = s.b + by


def step(s, x, p):
    late = ago(x, 2) if p.gain > 0 else ago(x, 1)
    whole = int(floor(p.delay))
    late = late + (p.delay - whole) * ago(x, whole + 1)
    total = 0.0
    for i in range(3):
        total += p.row[i] * sin(HALF * x + i) * (-1) ** i
    left = 1.0
    for _ in range(4):
        if left <= 1e-9:
            break
        span = min(left, 0.4 + 0.1 * abs(s.a))
        if not (s.a < 0 or s.b >= 1.0):
            s.a, s.b = s.a - span * s.b, s.b * exp(-span) + 0.1 * late
        elif 0.0 <= s.a <= 1.0 and s.b != 0.5:
            s.a = s.a / (1.0 + span)
        else:
            s.a += span * sqrt(1.0 + p.gain * p.gain) * log(2.0 + cos(x))
            move(s, sign(s.a) * span * p.gain)
        left -= span
    add, times = both(s.a, s.b)
    s.a = max(squash(add, p), -2.0 * LIMIT, s.a - 1.0)
    s.b = 0.9 * s.b if times > 0.0 else HALF * s.b - 0.1 * p.gain
    k = int(min(max(floor(2.0 * s.b), 0.0), 2.0))
    s.n += 1
    y = s.a ** 2 + p.row[k] * s.b - total
    if y > 40.0:
        return 40.0
    return y + 1e-3 * s.n + late ** 3 - (+x)
'''


def everything():
    return dynamic(EVERYTHING, {"gain": 0.7, "delay": 1.3, "row": (0.3, -0.2, 0.5)}, bounds={"delay": (0.0, 9.0)})


@given(seed=st.integers(0, 2**32 - 1))
def test_derivatives_of_every_construct_are_those_of_differences(seed):
    """At samples where the branch taken is the same on both sides of the step, which most are; a shift that changes a
    branch shows as a difference that halves with the step, and is left out."""
    rng, block, N = np.random.default_rng(seed), everything(), 25
    theta = np.array(block.first) * (1.0 + 0.3 * rng.uniform(-1, 1, 5))
    x, dx = rng.uniform(-2, 2, N), rng.normal(size=N)
    J = np.zeros((N, 6))
    J[:, 0] = dx
    block.propagate(theta, x, J, 1)

    def central(h):
        run = lambda th, z: block.propagate(th, z, np.empty((N, 0)), 0)  # noqa: E731
        columns = [(run(theta, x + h * dx) - run(theta, x - h * dx)) / (2 * h)]
        columns += [(run(theta + e, x) - run(theta - e, x)) / (2 * h) for e in h * np.eye(5)]
        return np.array(columns).T

    coarse, fine = central(1e-5), central(3e-6)
    scale = max(1.0, np.abs(J).max())
    smooth = np.abs(coarse - fine) < 1e-6 * scale
    assert smooth.mean() > 0.5
    np.testing.assert_allclose(J[smooth], fine[smooth], rtol=0, atol=1e-6 * scale)


FUNCTIONS = (
    "exp(z)",
    "log(3.0 + z)",
    "sqrt(3.0 + z)",
    "tanh(z)",
    "logistic(z)",
    "sin(z)",
    "cos(z)",
    "abs(z)",
    "1.0 / (3.0 + z)",
    "-z",
)
FUNCTIONS += (
    "z ** 3",
    "(3.0 + z) ** p.g",
    "min(z, 0.1)",
    "max(z, 0.1, -z)",
    "z if z > 0.1 else 2.0 * z",
    "z * z - p.g",
)


def test_the_derivative_of_each_function_is_that_of_differences():
    """All in one step, each its own output in turn; central differences of 1e-6 are good to 1e-9."""
    lines = [f"    if p.which == {k}.0:\n        return {f}" for k, f in enumerate(FUNCTIONS)]
    text = "\n".join(["def step(s, x, p):", "    z = p.g * x", *lines, "    return 0.0", ""])
    block = dynamic(text, {"g": 0.8, "which": 0.0})
    x, h = np.array([-1.3, -0.4, 0.55, 1.7]), 1e-6

    def output(g, z):
        return block.propagate(np.array([g, which]), z, np.empty((4, 0)), 0)

    for which in map(float, range(len(FUNCTIONS))):
        J = np.ones((4, 3))
        block.propagate(np.array([0.8, which]), x, J, 1)
        numeric = [output(0.8, x + h) - output(0.8, x - h), output(0.8 + h, x) - output(0.8 - h, x), np.zeros(4)]
        np.testing.assert_allclose(J, np.array(numeric).T / (2 * h), atol=1e-8, err_msg=FUNCTIONS[int(which)])


def test_texts_of_every_construct_agree_with_the_run(tmp_path):
    block = everything()
    theta, u = np.array(block.first), np.random.default_rng(1).uniform(-2, 2, 300)
    fit = made(Chain((block,)), theta)
    agrees(python_run(fit, u), fit.model.simulate(theta, u))
    agrees(c_run(fit, u, tmp_path), fit.model.simulate(theta, u))


STEP = "def step(s, x, p):\n    y = s.v\n    {}\n    return y\n"
REFUSED = {
    "while y > 0.0: y -= 1.0": "line 3 of step, `while y > 0.0: y -= 1.0`: a step may use numbers",
    "import os": "line 3 of step, `import os`",
    "y = open('f')": "line 3 of step",
    "y = x.real": "line 3 of step",
    "y = s.v.real": "line 3 of step",
    "y = [x]": "line 3 of step",
    "y = (lambda: x)()": "line 3 of step",
    "y = 'text'": "line 3 of step",
    "y = other": "other has no value here",
    "x = 1.0": "x is an argument",
    "p.gain = 1.0": "only states",
    "for i in range(int(x)): y += 1.0": "the number of loop passes",
    "for i in (1, 2): y += i": "a loop is for name in range",
    "for i in range(3): return y": "does not stand in a loop",
    "y, z = x": "2 names for 1 values",
    "y = ago(y, 1)": "ago looks back at the step's input alone",
    "y = ago(x, int(s.v))": "may not depend on states",
    "y = step(s, x, p)": "may not call itself",
    "y = p.gain + p.gain[0]": "with and without an index",
    "y = exp(x, x)": "line 3 of step",
    "y = x if x > 0.0 else z": "z has no value here",
    "y = x @ x": "line 3 of step",
    "y = z = x": "line 3 of step",
    "break": "line 3 of step",
    "del y": "line 3 of step",
    "return": "a step returns one output",
}


@pytest.mark.parametrize("line", REFUSED)
def test_what_the_subset_does_not_hold_is_refused_by_line(line):
    with pytest.raises(InputError) as refused:
        read(STEP.format(line))
    assert REFUSED[line] in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def step(s, x, p) return x", "line 1 of the step's text is not valid Python"),
        ("import os\ndef step(s, x, p):\n    return x\n", "line 1 of the step's text is neither"),
        ("A = [1]\ndef step(s, x, p):\n    return x\n", "assigns no number to A"),
        ("def other(s, x, p):\n    return x\n", "defines no step"),
        ("def step(x):\n    return x\n", "step takes 1 argument"),
        ("def step(s, x, p, *more):\n    return x\n", "plain arguments"),
        ("def step(s, x, p):\n    s.v = x\n", "does not return on every path"),
        ("def step(s, x, p):\n    if x > 0.0:\n        z = x\n    return z\n", "z may be read before it has a value"),
        ("def step(s, x, p):\n    for i in range(2):\n        z = x\n    return z\n", "z may be read before"),
        ("def f(v):\n    s = v\n\ndef step(s, x, p):\n    return f(x)\n", "does not return on every path"),
    ],
)
def test_a_text_that_is_no_step_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        read(text)


def test_parameters_that_do_not_fit_the_step_are_refused():
    text = "def step(s, x, p):\n    return p.gain * x\n"
    with pytest.raises(InputError, match="reads gain, which is not a parameter"):
        dynamic(text, {})
    with pytest.raises(InputError, match="never reads loss"):
        dynamic(text, {"gain": 1.0, "loss": 1.0})
    with pytest.raises(InputError, match="unknown parameter 'gian'"):
        dynamic(text, {"gain": 1.0}, bounds={"gian": (0.0, 1.0)})
    with pytest.raises(InputError, match="are outside the bounds"):
        dynamic(text, {"gain": 1.0}, bounds={"gain": (2.0, 3.0)})
    with pytest.raises(InputError, match="no block to read"):
        dynamic("def step(s, x, p, block):\n    return p.gain * x * block.n\n", {"gain": 1.0})


def test_a_step_without_source_is_refused_and_its_text_taken():
    space: dict = {}
    text = "def step(s, x, p):\n    return p.gain * x\n"
    exec(text, space)
    with pytest.raises(InputError, match="give the text of the step"):
        dynamic(space["step"], {"gain": 1.0})
    block = dynamic(text, {"gain": 2.0})
    np.testing.assert_array_equal(block.propagate(np.array([3.0]), np.arange(4.0), np.empty((4, 0)), 0), [0, 3, 6, 9])


def test_an_index_that_a_state_has_driven_anywhere_stays_in_its_row():
    """A state that is not a number, or beyond all numbers, reads no memory beside the parameters."""
    text = "def step(s, x, p):\n    s.v = s.v * 1e200 + x\n    return p.row[int(s.v)]\n"
    block = dynamic(text, {"row": (1.0, 2.0)})
    y = block.propagate(np.array([1.0, 2.0]), np.array([-1.0, 0.0, 5.0, np.nan, 1.0]), np.empty((5, 0)), 0)
    assert set(y) <= {1.0, 2.0}


def test_a_look_back_into_the_future_has_no_value():
    block = dynamic("def step(s, x, p):\n    return ago(x, int(p.n))\n", {"n": 1.0})
    J = np.zeros((4, 2))
    assert np.all(np.isnan(block.propagate(np.array([-2.0]), np.arange(4.0), J, 1)))


def test_what_a_motor_does_not_have_leaves_no_line():
    def words(**options):
        block = Motor(role="part", **options)
        return block.c(0.3 + 0.1 * np.arange(block.n_parameters)).body

    plain = words(load=0, delayed=False, stops=False)
    assert not [w for w in ("jammed", "load", "lost", "exp(-ratio", "part", "beyond", "place") if w in plain]
    everything = words(load=3, loss=True, stribeck=True, jams=True)
    assert "jammed" in everything
    assert "ratio" in everything
    assert plain.count("exp(") == 1  # the lag's own


def test_two_processes_that_write_one_kernel_at_once_both_run_it(tmp_path):
    code = (
        "import numpy as np; from sysid.blocks import dynamic;"
        "b = dynamic('def step(s, x, p):\\n    s.v += p.g * x\\n    return s.v\\n', {'g': 1.0});"
        "print(b.propagate(np.array([2.0]), np.ones(3), np.empty((3, 0)), 0).tolist())"
    )
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", code], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    for run in runs:
        out, err = run.communicate(timeout=300)
        assert out.strip() == "[2.0, 4.0, 6.0]", err
    folder = tmp_path / "sysid" / "kernels"
    assert len(list(folder.glob("*.kernel"))) == 1
    assert not list(folder.glob("*.part"))


def test_without_a_folder_to_write_to_a_block_still_runs(tmp_path, monkeypatch):
    """Neither the library's folder nor the user's cache can be written: compiled for this process alone."""
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setattr(kernel, "_folders", lambda near: [blocked / "a", blocked / "b"])
    block = dynamic("def step(s, x, p):\n    s.v += 3.0 * p.g * x\n    return s.v\n", {"g": 1.0})
    assert block.propagate(np.array([2.0]), np.ones(2), np.empty((2, 0)), 0).tolist() == [6.0, 12.0]


def test_a_changed_step_or_compiler_is_compiled_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel, "_folders", lambda near: [tmp_path])

    def output(factor):
        text = f"def step(s, x, p):\n    return {factor} * p.g * x\n"
        return dynamic(text, {"g": 1.0}).propagate(np.ones(1), np.ones(1), np.empty((1, 0)), 0)[0]

    assert [output(2.0), output(5.0), output(2.0)] == [2.0, 5.0, 2.0]
    assert len(list(tmp_path.glob("*.kernel"))) == 2
    monkeypatch.setattr(kernel, "_version", lambda: "another")
    output(2.0)
    assert len(list(tmp_path.glob("*.kernel"))) == 3


def test_importing_the_blocks_writes_and_compiles_nothing(tmp_path):
    code = "import sys, sysid.blocks; print([m for m in sys.modules if 'numba' in m or 'sysid_compiled' in m])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    importlib.import_module("sysid.blocks")


def test_slopes_are_numbers_where_an_exponential_is_infinite():
    """At either end of a sigmoid the slope is 0, and the weight's derivative is the value of the unit there."""
    block = BLOCKS["sigmoid_network"][0]
    n = block.units
    theta = np.concatenate([[0.5, 2.0], np.full(n, 3.0), np.full(n, 1e4), np.zeros(n)])
    x = np.array([-1.0, 1.0])
    J = np.zeros((2, 1 + len(theta)))
    J[:, 0] = 1.0
    y = block.propagate(theta, x, J, 1)
    np.testing.assert_allclose(y, [-1.5, 2.5 + 3.0 * n])
    np.testing.assert_allclose(J[:, 0], 2.0)
    np.testing.assert_allclose(J[:, 3 : 3 + n], np.outer([0.0, 1.0], np.ones(n)), atol=1e-300)
    np.testing.assert_array_equal(J[:, 3 + n :], 0.0)


@pytest.mark.parametrize("rest", [-0.8, 0.3, 0.8])
def test_a_coasting_link_begins_where_it_is_told_even_beyond_its_sides(rest):
    """A search for the first state tries such places; it needs their output and their derivative to find back."""
    J = np.zeros((5, 5))
    y = CoastingPlay().propagate(np.array([0.4, rest, 0.1, 0.0, 0.0]), np.full(5, 2.0), J, 0)
    assert y[0] == 2.0 + rest * 0.4
    np.testing.assert_array_equal(J[0], [rest, 0.4, 0.0, 0.0, 0.0])
    assert abs(y[1] - 2.0) <= 0.2 + 1e-12


def test_a_motor_that_begins_beyond_a_stop_is_the_same_in_every_text(tmp_path):
    """One that does not jam loses its speed at the stop and no time, in the compiled run as in the files."""
    block, theta = BLOCKS["motor"]
    theta = np.where([s.name == "x0" for s in block.slots()], -0.2, theta)
    u = np.random.default_rng(0).uniform(1.0, 3.0, 60)
    fit = made(Chain((block,)), theta)
    agrees(python_run(fit, u), fit.model.simulate(theta, u))
    agrees(c_run(fit, u, tmp_path), fit.model.simulate(theta, u))


@pytest.mark.parametrize("damage", ["", "garbage\x00(", "def value(:\n"])
def test_a_damaged_kernel_is_made_again(damage, tmp_path):
    text = "def step(s, x, p):\n    s.a = 0.5 * s.a + p.g * x\n    return s.a\n"
    code = (
        "import numpy as np\nfrom sysid.blocks import dynamic\n"
        f"block = dynamic({text!r}, {{'g': 2.0}})\n"
        "print(block.output(np.array([2.0]), np.ones(3)).tolist())"
    )
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}

    def run():
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
        return done.stdout.strip()

    assert run() == "[2.0, 3.0, 3.5]"
    (kernel_file,) = tmp_path.rglob("*.kernel")
    kernel_file.write_text(damage, encoding="utf-8")
    assert run() == "[2.0, 3.0, 3.5]"


HEAD = "def step(s, x, p):\n"
BUMP = "def bump(s):\n    s.a += 1.0\n    return s.a\n\n" + HEAD
DEEP = "+".join(["x"] * 120)
TWICE = "".join(f"def f{k}(v):\n    return f{k - 1}(v) + f{k - 1}(v)\n\n" for k in range(1, 18))
UNSAID = {  # what Python would run in another way than the compiled block, or not at all
    BUMP + "    y = s.a + bump(s)\n    return y\n": "line 2 of step, `y = s.a + bump(s)`: bump sets a state",
    BUMP + "    s.a += bump(s)\n    return s.a\n": "bump sets a state",
    BUMP + "    return bump(s) if x > 1.0 else 0.0\n": "bump sets a state",
    BUMP + "    if x > 0.0 and bump(s) > 1.0:\n        return 1.0\n    return 0.0\n": "bump sets a state",
    HEAD + "    return p.row[-1] * x\n": "the index of a row is -1",
    HEAD + "    y = 0.0\n    for i in range(3):\n        y += p.row[2 * i - 1]\n    return y\n": "becomes negative",
    HEAD + "    return x / 0\n": "divides by zero",
    HEAD + "    return x * 0 ** -1\n": "divides by zero",
    HEAD + "    return p.row[1.0] * x\n": "the index of a row is 1.0",
    HEAD + "    return p.row[s.n]\n": "the index of a row is not a whole number",
    HEAD + "    y = x or 1.0\n    return y\n": "line 2 of step, `y = x or 1.0`: and, or give true or false here",
    HEAD + "    return (x > 0.0) and x * 2.0\n": "write a if test else b",
    HEAD + "    for i in range(3):\n        i = 2\n    return x\n": "i counts the loop",
    HEAD + "    for i in range(2.0):\n        s.a += x\n    return s.a\n": "the number of loop passes",
    HEAD + "    return x\n\n" + HEAD + "    return -x\n": "defines step a second time",
    "def step(s, s, p):\n    return 1.0\n": "two arguments of one name",
    HEAD + "    return ago(x, 1.5)\n": "the lag of ago is 1.5",
    HEAD + "    return ago(x, -1)\n": "the lag of ago is -1",
    HEAD + "    return ago(x, p.n)\n": "the lag of ago is not a whole number",
    HEAD + "    k = int(x)\n    return ago(x, k)\n": "may not depend on states or the input",
    HEAD + "    y = 0.0\n    for i in range(3):\n        y += ago(x, i - 1)\n    return y\n": "becomes negative",
    "def begin(s, x, p):\n    s.a = ago(x, 1)\n\n" + HEAD + "    return s.a\n": "begin runs at the first sample",
    HEAD + f"    return {DEEP}\n": "levels deep",
    HEAD + f"    return {DEEP}{'+x' * 3000}\n": "nests too deep",
    HEAD + f"    return x * {10**400}\n": "whole numbers are at most",
    f"K = {2**40}\n\n" + HEAD + "    return x * K\n": "a whole number beyond",
    HEAD + "    return x * 9 ** 9 ** 8\n": "this power is too large",
    HEAD + "    return x * (2147483647 * 2)\n": "whole numbers are at most",
    HEAD + "    k = 1\n    for i in range(90):\n        k = 3 * k\n    return x * k\n": "the whole number k grows",
    HEAD + "    k = 1\n    for i in range(90):\n        k += k\n    return x * k\n": "the whole number k grows",
    "A = {[]: 1}\n\n" + HEAD + "    return x\n": "assigns no number to A",
    HEAD + "    return x\0\n": "not valid Python",
    "def f0(v):\n    return v + 1.0\n\n" + TWICE + HEAD + "    return f17(x)\n": "over 2000 statements",
    "sign = 2.0\n\n" + HEAD + "    return sign(x)\n": "sign is a value here",
    HEAD + "    max = 2.0\n    return max(x, 1.0)\n": "max is a value here",
}


@pytest.mark.parametrize("text", UNSAID, ids=[str(k) for k in range(len(UNSAID))])
def test_a_step_that_would_run_otherwise_than_in_python_is_refused(text):
    with pytest.raises(InputError) as refused:
        read(text)
    assert UNSAID[text] in str(refused.value)
    assert len(str(refused.value)) < 700


SAME = {  # by their text, with the parameters
    "a helper called value": ("def value(x, p):\n    return 2.0 * x\n\n" + HEAD + "    return value(x, p) + p.g\n", 1),
    "a helper called sign": ("def sign(v):\n    return 5.0 * v\n\n" + HEAD + "    return p.g * sign(x)\n", 1),
    "a state set alone": (BUMP + "    y = bump(s)\n    z = s.a\n    bump(s)\n    return p.g * (y + 2.0 * z) + x\n", 1),
    "a state returned": (BUMP + "    s.a *= x\n    return bump(s)\n", 0),
    "powers of whole numbers": (
        HEAD + "    y = 0.0\n    for i in range(5):\n        y += p.g * x * 2 ** (i - 2)\n    return y\n",
        1,
    ),
    "an empty loop and helper": (
        "def none(s):\n    pass\n\n"
        + HEAD
        + "    for i in range(3):\n        pass\n    if x > 0.0:\n        none(s)\n    return p.g * x\n",
        1,
    ),
    "an index left early": (
        HEAD + "    y = 0.0\n    for i in range(5):\n        if i > 2:\n            break\n"
        "        y += p.row[i] * x\n    return y\n",
        3,
    ),
    "large whole numbers": (HEAD + "    k = int(x * 1e10)\n    return p.g * x + k\n", 1),
    "tests of tests": (HEAD + "    up = x > 0.0 and not x > 1.0 or x == -1.0\n    return p.g if up or s.b else x\n", 1),
    "names of files": (HEAD + "    out, x_ = p.g * x, s.x\n    out_ = out + x_\n    s.x = out_\n    return out_\n", 1),
}


def in_python(text, p, x):
    """The text itself, run by Python sample by sample."""
    space = {k: getattr(importlib.import_module("sysid.block.step"), k) for k in ("floor", "exp", "sqrt", "sign")}
    exec(text, space)
    s = SimpleNamespace(a=0.0, b=0.0, x=0.0)
    return np.array([space["step"](s, now, p) for now in x])


@pytest.mark.parametrize("name", SAME)
def test_a_step_runs_as_python_runs_it_and_so_do_its_files(name, tmp_path):
    text, n = SAME[name]
    block = dynamic(text, {"row": (0.1, 0.2, 0.3)} if n == 3 else {"g": 0.7} if n else {})
    x = np.random.default_rng(2).uniform(-2.0, 2.0, 40)
    theta = np.array(block.first)
    expected = in_python(text, SimpleNamespace(g=0.7, row=(0.1, 0.2, 0.3)), x.tolist())
    np.testing.assert_allclose(block.propagate(theta, x, np.empty((40, 0)), 0), expected, rtol=1e-14)
    fit = made(Chain((block,)), theta)
    agrees(python_run(fit, x), expected)
    agrees(c_run(fit, x, tmp_path), expected)


def test_an_index_beyond_its_row_is_the_last_one_in_the_files_too(tmp_path):
    """The kernel keeps within the row, and C must not read beside its table. Two rows differ by their case alone."""
    text = HEAD + "    k = int(floor(3.0 * x))\n    return p.a[k] + 10.0 * p.A[k - 1]\n"
    block = dynamic(text, {"a": (1.0, 2.0, 3.0), "A": (4.0, 5.0)})
    theta, x = np.array(block.first), np.random.default_rng(2).uniform(-2.0, 2.0, 60)
    k = np.floor(3.0 * x).astype(int)
    expected = theta[np.clip(k, 0, 2)] + 10.0 * theta[3 + np.clip(k - 1, 0, 1)]
    np.testing.assert_array_equal(block.propagate(theta, x, np.empty((60, 0)), 0), expected)
    fit = made(Chain((block,)), theta)
    agrees(python_run(fit, x), expected)
    agrees(c_run(fit, x, tmp_path), expected)
    with pytest.raises(InputError, match=r"reads p.a\[3\], and the row a has 3"):
        dynamic(HEAD + "    return p.a[3] * x\n", {"a": (1.0, 2.0, 3.0)})


GAIN = HEAD + "    return p.g * x\n"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"parameters": {"g": "much"}}, "the start value of g"),
        ({"parameters": {"g": None}}, "the start value of g"),
        ({"parameters": {"g": np.nan}}, "the start value of g"),
        ({"parameters": {"g": 1j}}, "the start value of g"),
        ({"parameters": {"g": ()}}, "the start value of g"),
        ({"parameters": {1: 1.0}}, "parameters is"),
        ({"parameters": ["g"]}, "parameters is"),
        ({"bounds": {"g": 1.0}}, "the bounds of g"),
        ({"bounds": {"g": (2.0, 0.0)}}, "the bounds of g"),
        ({"bounds": {"g": (0.0, 1.0, 2.0)}}, "the bounds of g"),
        ({"bounds": {"g": (np.nan, 2.0)}}, "the bounds of g"),
        ({"bounds": [("g", 1.0)]}, "bounds is"),
        ({"holds": ("g",)}, "not in initial"),
        ({"initial": "g"}, "initial is"),
        ({"initial": (1,)}, "initial is"),
        ({"initial": 3}, "initial is"),
        ({"span": (1.0, 1.0)}, "span is"),
        ({"span": (0.0, np.inf)}, "span is"),
        ({"span": 3.0}, "span is"),
        ({"role": "two words"}, "role is"),
        ({"role": 3}, "role is"),
        ({"step": 3}, "step is a int"),
    ],
)
def test_arguments_of_dynamic_that_do_not_fit_are_refused(given, said):
    with pytest.raises(InputError) as refused:
        dynamic(**{"step": GAIN, "parameters": {"g": 1.0}, **given})
    assert said in str(refused.value)


def test_names_that_mean_two_things_in_two_modules_are_refused(tmp_path, monkeypatch):
    (tmp_path / "helpers_of_test.py").write_text(
        "K = 3.0\n\ndef scaled(v):\n    return K * v\n\ndef sign(v):\n    return v\n\ndef value(v):\n    return v\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def block(body, head=""):
        own = tmp_path / f"own_{len(list(tmp_path.iterdir()))}.py"
        own.write_text(f"from helpers_of_test import scaled, sign, value\n{head}\ndef step(s, x, p):\n    {body}\n")
        return dynamic(importlib.import_module(own.stem).step, {"g": 1.0})

    with pytest.raises(InputError, match="K means different things"):
        block("return p.g * scaled(x) + K", "K = 2.0\n")
    with pytest.raises(InputError, match="step uses sign, which is a name of the step's language"):
        block("return p.g * sign(x)")
    with pytest.raises(InputError, match="calls a function value"):
        block("return p.g * value(x)")
    run = block("s.value = p.g * scaled(x)\n    return s.value + K", "K = 3.0\n")
    assert run.propagate(np.array([2.0]), np.ones(1), np.empty((1, 0)), 0)[0] == 9.0

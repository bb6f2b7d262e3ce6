"""What is derived from a step, against plain Python, against differences and against the exported files."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from exported import agrees, c_run, made, python_run
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from sysid.block import step as language
from sysid.block.compiler import subset
from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.recursion import Map, Recursion, Written
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


TERMS = (
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
TERMS += (
    "z ** 3",
    "(3.0 + z) ** p.g",
    "min(z, 0.1)",
    "max(z, 0.1, -z)",
    "z if z > 0.1 else 2.0 * z",
    "z * z - p.g",
)
TERMS += tuple(f"{name}(0.5 + 0.2 * tanh(z))" for name, f in FUNCTIONS.items() if f.slope)


def test_the_derivative_of_each_function_is_that_of_differences():
    """All in one step, each its own output in turn; central differences of 1e-6 are good to 1e-9."""
    lines = [f"    if p.which == {k}.0:\n        return {f}" for k, f in enumerate(TERMS)]
    text = "\n".join(["def step(s, x, p):", "    z = p.g * x", *lines, "    return 0.0", ""])
    block = dynamic(text, {"g": 0.8, "which": 0.0})
    x, h = np.array([-1.3, -0.4, 0.55, 1.7]), 1e-6

    def output(g, z):
        return block.propagate(np.array([g, which]), z, np.empty((4, 0)), 0)

    for which in map(float, range(len(TERMS))):
        J = np.ones((4, 3))
        block.propagate(np.array([0.8, which]), x, J, 1)
        numeric = [output(0.8, x + h) - output(0.8, x - h), output(0.8 + h, x) - output(0.8 - h, x), np.zeros(4)]
        np.testing.assert_allclose(J, np.array(numeric).T / (2 * h), atol=1e-8, err_msg=TERMS[int(which)])


def test_texts_of_every_construct_agree_with_the_run(tmp_path):
    block = everything()
    theta, u = np.array(block.first), np.random.default_rng(1).uniform(-2, 2, 300)
    fit = made(Chain((block,)), theta)
    agrees(python_run(fit, u), fit.model.simulate(theta, u))
    agrees(c_run(fit, u, tmp_path), fit.model.simulate(theta, u))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_has_one_value_in_the_run_in_constants_and_in_every_file(name, tmp_path):
    more = ", p.g" if name in ("min", "max") else ""
    block = dynamic(f"def step(s, x, p):\n    return p.g * x + {name}(x{more}) + {name}(0.6 * p.g{more})\n", {"g": 0.7})
    fit, x = made(Chain((block,)), np.array([0.7])), np.linspace(0.05, 0.95, 19)
    value = FUNCTIONS[name].value
    expected = [0.7 * u + value(u, *[0.7] * bool(more)) + value(0.6 * 0.7, *[0.7] * bool(more)) for u in x.tolist()]
    for y in (fit.simulate(x), python_run(fit, x), c_run(fit, x, tmp_path)):
        agrees(y, np.array(expected))


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


def test_a_step_is_read_once_for_all_that_is_written_of_a_block(monkeypatch):
    read, times = subset.read, []
    monkeypatch.setattr(subset, "read", lambda *words: times.append(words) or read(*words))
    motor = Motor(load=3)
    theta = motor.start(np.ones(9))
    motor.c(theta)
    motor.python(theta)
    assert len(times) == 1


def test_a_motor_without_rare_parts_has_a_kernel_of_its_own_and_the_same_numbers():
    plain = Motor(load=3, stribeck=True, sided=True, loss=True, jams=True, substeps=2)
    wide = Motor(load=3, stribeck=True, sided=True, loss=True, jams=True, substeps=2, periodic=1, further=("windage",))
    module, _ = plain._kernels
    assert not {"windage", "warmth"} & set(module.PARAMETERS)
    assert {"windage", "warmth"} <= set(wide._kernels[0].PARAMETERS)
    # A joint is tried with a load that repeats every turn: a loop for it alone would compile as long as the first one.
    assert Motor(load=1, periodic=2)._kernels[0] is module
    values = {"gain": 0.02, "lag": 0.4, "rise": 1.0, "fall": 1.4, "stick": 0.3, "stick_speed": 0.01, "stick_down": 0.2}
    values |= {"load0": 0.4, "load1": 0.8, "load2": -0.5, "loss": 0.3, "jam": 20.0, "delay": 0.3, "upper": 1.0}
    x = 8.0 * np.sin(0.03 * np.arange(600.0)) + np.sin(np.arange(600.0))
    runs = {}
    for motor in (plain, wide):
        theta = np.array([values.get(slot.name, 0.0) for slot in motor.slots()])
        J = np.zeros((len(x), len(theta)))
        y = motor.propagate(theta, x, J, 0)
        runs[motor] = y, dict(zip([slot.name for slot in motor.slots()], J.T, strict=True))
    assert runs[plain][0].min() == 0.0  # it strikes both ends
    assert runs[plain][0].max() == 1.0
    assert np.array_equal(runs[plain][0], runs[wide][0])
    for name, column in runs[plain][1].items():
        assert np.array_equal(column, runs[wide][1][name]), name


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
    """One that does not jam loses no time at the stop, in the compiled run as in the files."""
    block, theta = BLOCKS["motor"]
    theta = np.where([s.name == "x0" for s in block.slots()], -0.2, theta)
    u = np.random.default_rng(0).uniform(1.0, 3.0, 60)
    fit = made(Chain((block,)), theta)
    agrees(python_run(fit, u), fit.simulate(u))
    agrees(c_run(fit, u, tmp_path), fit.simulate(u))


HEAD = "def step(s, x, p):\n"
BUMP = "def bump(s):\n    s.a += 1.0\n    return s.a\n\n" + HEAD


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
    space = {**vars(math), **vars(language)}
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

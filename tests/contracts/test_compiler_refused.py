"""What the language of a step does not hold is refused by its line, and so is what Python would run otherwise."""

import importlib

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.block.compiler.subset import read
from sysid.blocks import dynamic

HEAD = "def step(s, x, p):\n"
BUMP = "def bump(s):\n    s.a += 1.0\n    return s.a\n\n" + HEAD
DEEP = "+".join(["x"] * 120)
TWICE = "".join(f"def f{k}(v):\n    return f{k - 1}(v) + f{k - 1}(v)\n\n" for k in range(1, 18))
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

"""The MATLAB function file against `simulate`: run by GNU Octave where it is there, by a reader of its own anywhere.

The reader below turns the file back into Python line by line; it knows the language from its manual, not from the
exporter, and so finds a wrong index, sign or bracket on a machine without Octave.
"""

import math
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from exported import excitation, made

import sysid
from sysid import InputError
from sysid.blocks import Channels, StateSpace, TransferMatrix
from sysid.data.preprocess import detrend
from sysid.export import matlab
from sysid.export.matlab_text import matlab as translated
from sysid.model.chain import Chain

CASES = {**{k: v for k, v in BLOCKS.items() if k != "custom"}, **VARIANTS, **MOVING}


def network():
    rng = np.random.default_rng(0)
    u, y = np.repeat(rng.uniform(-1, 1, 60), 5), np.zeros(300)
    for t in range(1, 300):
        y[t] = 0.7 * y[t - 1] + np.tanh(2 * u[t - 1])
    data = sysid.IOData(u + 3.0, y - 5.0 + 0.01 * rng.standard_normal(300), 0.1)
    return sysid.fit(sysid.structures.nlarx(2, 2, 1, units=2), detrend(data), starts=1)


def fit_of(name):
    block, theta = CASES[name]
    fit = made(Chain((block,)), theta)
    n_in, n_out = fit.model.channels
    return replace(fit, u_offset=0.5 * np.arange(1, n_in + 1), y_offset=-3.0 * np.arange(1, n_out + 1))


def expected(fit, u):
    own = np.asarray(u) - (fit.u_offset if np.ndim(u) > 1 else fit.u_offset[0])
    y = fit.simulate(own)  # filters and speeds from rest, positions from where the fit has them
    return y + (fit.y_offset if y.ndim > 1 else fit.y_offset[0])


# A reader of the language: what the files use, no more.


class Row:
    """A row of numbers, counted from 1."""

    def __init__(self, values):
        self.values = list(values)

    def __call__(self, k):
        if isinstance(k, slice):
            return Row(self.values[k.start - 1 : k.stop])
        assert float(k).is_integer()
        assert 1 <= k <= len(self.values)
        return self.values[int(k) - 1]


def _row(*parts):
    return Row(v for p in parts for v in (p.values if isinstance(p, Row) else [p]))


def _smallest(*values):
    return min(values)


SPACE = {
    **vars(math),
    "abs": abs,
    "min": _smallest,
    "max": lambda *values: max(values),
    "fix": math.trunc,
    "Inf": math.inf,
    "_row": _row,
    "zeros": lambda n, m: Row([0.0] * (n * m)),
    "repmat": lambda value, n, m: Row(value.values * m if isinstance(value, Row) else [value] * m),
    "arrayfun": lambda f, over: Row(f(k) for k in over),
    "_span": lambda a, b: range(int(a), int(b) + 1),
    "sum": lambda values: sum(values.values),
    "log": lambda x: math.log(x) if x > 0 else (-math.inf if x == 0 else math.nan),
    "exp": lambda x: math.exp(min(x, 709.0)),
}


def _python(text):
    """An expression of the language in Python's words."""
    text = text.replace("~=", "!=").replace("&&", " and ").replace("||", " or ").replace("^", "**")
    text = re.sub(r"~(?!=)", " not ", text)
    text = re.sub(r"@\((\w+)\)", r"lambda \1:", text)
    text = re.sub(r"(lambda \w+:.*), 0:([^()]+)\)", r"\1, _span(0, \2))", text) if "lambda" in text else text
    while "[" in text:
        text = re.sub(r"\[([^][]*)\]", r"_row(\1)", text)
    return re.sub(r"\((\d+):(end(?: - \d+)?|\d+)\)", lambda m: f"(slice({m[1]}, {_end(m[2])}))", text)


def _end(text):
    return "None" if text == "end" else f"-({text[6:]})" if text.startswith("end") else text


def _loop(text):
    """Inner comprehensions first: _span() of each arrayfun."""
    pattern = re.compile(r", 0:(\d+|[^(),]+ - 1)\)")
    while pattern.search(text):
        text = pattern.sub(r", _span(0, \1))", text, count=1)
    return text


def read(source):
    """The functions of a file as Python, by name."""
    lines, depth = ["class Fields: pass"], 0
    for raw in source.splitlines():
        line = raw.partition("%")[0].strip()
        if not line:
            continue
        if head := re.fullmatch(r"function (?:\[(.*)\]|(\w+)) = (\w+)\((.*)\)", line):
            result = head[1] or head[2]
            arguments = ", ".join(f"{a}=None" for a in head[4].split(", ") if a)
            lines += [f"def {head[3]}({arguments}):"]
            depth, results = 1, result
            continue
        if line == "end":
            depth -= 1
            if not depth:
                lines.append(f"    return {results}")
            continue
        if line.startswith(("else", "elseif")):
            depth -= 1
        lines.append("    " * depth + _line(line, results))
        depth += line.startswith(("if ", "elseif ", "else", "for "))
    space = dict(SPACE)
    exec("\n".join(lines), space)
    return space


def _line(line, results):
    line = _loop(line.rstrip(";"))
    if loop := re.fullmatch(r"for (\w+) = 0:(.*)", line):
        return f"for {loop[1]} in _span(0, {_python(loop[2])}):"
    if test := re.fullmatch(r"(if|elseif) (.*)", line):
        return f"{'elif' if test[1] == 'elseif' else 'if'} {_python(test[2])}:"
    if line == "else":
        return "else:"
    if line == "return":
        return f"return {results}"
    if line == "break":
        return line
    target, _, value = line.partition(" = ")
    if value == "struct()":
        return f"{target} = Fields()"
    if part := re.fullmatch(r"(\w+)\((.*)\)", target):
        if ":" in part[2]:
            first, last = part[2].split(":")
            return f"{part[1]}.values[{first} - 1:{_end(last)}] = ({_python(value)}).values"
        return f"{part[1]}.values[int({_python(part[2])}) - 1] = {_python(value)}"
    return f"{target.strip('[]')} = {_python(value)}"


def read_run(fit, u):
    """The file's own functions of a state and a sample, a sample at a time."""
    source = matlab.source(fit, "exported")
    space = read(source[source.index("function state = exported_initial()") :])
    state, found = space["exported_initial"](), []
    for sample in np.atleast_2d(np.asarray(u).T).T:
        y, state = space["exported_sample"](Row(sample.tolist()), state)
        found.append(y.values)
    y = np.array(found)
    return y[:, 0] if y.shape[1] == 1 else y


def close(y, wanted):
    np.testing.assert_allclose(y, wanted, rtol=0, atol=1e-9 * max(1.0, float(np.abs(wanted).max())))


@pytest.mark.parametrize("name", sorted(CASES))
def test_every_block_reads_back_to_its_run(name):
    fit = fit_of(name)
    u = excitation(fit.model.channels[0], 100)
    close(read_run(fit, u), expected(fit, u))


def test_a_network_reads_back_to_its_run():
    fit = network()
    u = excitation(N=60) + 3.0
    close(read_run(fit, u), expected(fit, u))


def octave(files, folder):
    """Run all files in one process, as starting it takes longest; texts by name."""
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        pytest.skip("no GNU Octave (octave-cli) on this machine")
    script = ["format long"]
    for name in files:
        script.append(f"y = {name}(dlmread('{name}.u')); dlmwrite('{name}.y', y, 'delimiter', ' ', 'precision', 17);")
        script.append(f"state = []; [a, state] = {name}(dlmread('{name}.u')(1:7, :));")
        script.append(f"[b, state] = {name}(dlmread('{name}.u')(8:end, :), state); assert(isequal([a; b], y));")
    (folder / "run_all_files.m").write_text("\n".join(script))
    done = subprocess.run([program, "--no-init-file", "run_all_files.m"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {name: np.loadtxt(folder / f"{name}.y") for name in files}


def test_octave_runs_every_file_to_the_same_numbers(tmp_path):
    fits = {f"b_{name}": fit_of(name) for name in CASES} | {"network": network()}
    inputs = {}
    for name, fit in fits.items():
        matlab.write(fit, tmp_path / f"{name}.m")
        inputs[name] = excitation(1 if name == "network" else fit.model.channels[0], 100)
        np.savetxt(tmp_path / f"{name}.u", inputs[name], fmt="%.17g")
    for name, y in octave(fits, tmp_path).items():
        close(y, expected(fits[name], inputs[name]))


def test_a_chain_of_several_blocks_and_channels():
    first = Channels(maps=(BLOCKS["saturation"][0], BLOCKS["polynomial"][0]), role="input")
    chain = Chain((first, BLOCKS["transfer_matrix"][0]))
    fit = made(chain, np.concatenate([BLOCKS["saturation"][1], BLOCKS["polynomial"][1], BLOCKS["transfer_matrix"][1]]))
    u = excitation(2, 80)
    close(read_run(fit, u), fit.simulate(u))
    assert isinstance(chain.blocks[1], TransferMatrix)
    assert any(isinstance(block, StateSpace) for block, _ in CASES.values())


@pytest.mark.parametrize(
    ("python", "said"),
    [
        (
            "y = a if b > 1 else c\nreturn y",
            ["if b > 1", "    y = a;", "else", "    y = c;", "end", "out = y;", "return"],
        ),
        ("return x - (a - b) / (c * d)", ["out = x - (a - b) / (c * d);", "return"]),
        ("return -(a + b) ** 2", ["out = -(a + b)^2;", "return"]),
        ("return (-a) ** 2", ["out = (-a)^2;", "return"]),
        ("end = s[0] + s[k - 1]\nreturn end", ["end_ = s(1) + s(k - 1 + 1);", "out = end_;", "return"]),
        (
            "s[3:] = [x] + s[3:-1]\nreturn not (a or b) and c",
            ["s(4:end) = [x, s(4:end - 1)];", "out = ~(a || b) && c;", "return"],
        ),
        ("s[1:] = [x] * 2\nreturn s[1]", ["s(2:end) = repmat([x], 1, 2);", "out = s(2);", "return"]),
    ],
)
def test_statements_one_by_one(python, said):
    assert translated(python) == said


@pytest.mark.parametrize(
    "python", ["while x:\n    break", "return x // 2", "return {}", "return foo(x)", "return x[::2]"]
)
def test_what_is_beyond_the_subset_is_refused(python):
    with pytest.raises(InputError, match="cannot be written as MATLAB"):
        translated(python)


def test_the_file_has_a_name_that_matlab_takes(tmp_path):
    with pytest.raises(InputError, match="not an identifier"):
        matlab.write(fit_of("saturation"), tmp_path / "2-legs.m")
    with pytest.raises(InputError, match="'end' has a meaning in MATLAB"):
        matlab.write(fit_of("saturation"), tmp_path / "end.m")
    text = matlab.write(fit_of("saturation"), tmp_path / "knee.m").read_text()
    assert text.startswith("function [y, state] = knee(u, state)\n%KNEE Exported model")

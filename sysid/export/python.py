"""A fitted chain as one standalone Python file that imports only math, made from the code of each block."""

import os
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.files import write_text
from sysid.block.writing import Code, number
from sysid.export import closed_form
from sysid.export.program import AnyFit, Offset, channel_counts, program
from sysid.model.wiring import Layer, Unit, whole


@checked
def write(fit: AnyFit, path: str | os.PathLike, **scale: Offset) -> Path:
    """Write `source` to a file, complete or not at all."""
    return write_text(path, source(fit, **scale))


@checked
def source(fit: AnyFit, u_offset: Offset = None, y_offset: Offset = None) -> str:
    """Python text of the fit's free run: class Model with step(u) -> y, and simulate(u) -> list.

    Filters and speeds start from rest, positions and backlash at the fit's initial values (a new Model()), as in
    `Fit.simulate(u)`. A sample of several channels is a sequence of numbers. It takes and gives the levels of raw
    records: u_offset (nu,) and y_offset (ny,) are what was removed from the estimation data, by default as the fit
    knows it. Run as a program it reads u from standard input, one sample per line, and prints y. Raises InputError for
    a block without a formula.
    """
    whole_fit = program(fit, u_offset, y_offset)
    n_in, n_out = channel_counts(fit)
    codes, form = whole_fit.codes, closed_form.text(fit, u_offset=u_offset, y_offset=y_offset)
    comment = "\n".join(f"# {line}".rstrip() for line in form.rstrip().split("\n"))
    states = [_state(unit, code) for unit, code in codes.items() if code.state]
    begin = "from the fit's first position" if any(code.start for code in codes.values()) else "from rest"
    steps = _step(whole_fit.layers, codes, whole_fit.u_offset, whole_fit.y_offset)
    call = "model.step(*values)" if n_in == 1 else "model.step(values)"
    return f'''"""Exported model: Model().step(u) gives y sample by sample, simulate(u) a whole record, {begin}."""

{comment}

import math

TS = {number(fit.Ts)}  # s


{_blank2.join(_function(unit, code) for unit, code in codes.items())}


class Model:
    """One run of the model; a new instance starts {begin}."""

    def __init__(self):
{_newline.join(states) or "        pass"}

    def step(self, u):
        """y for the next sample u{"" if n_in == 1 else f" ({n_in} numbers)"}."""
{_newline.join(steps)}


def simulate(u):
    """Free run {begin}: a list of y for a sequence of u."""
    model = Model()
    return [model.step(value) for value in u]


if __name__ == "__main__":
    import sys

    model = Model()
    for line in sys.stdin:
        values = [float(word) for word in line.split()]
        if values:
            y = {call}
            print({"repr(y)" if n_out == 1 else '" ".join(repr(v) for v in y)'})
'''


_newline, _blank2 = "\n", "\n\n\n"


def _state(unit: str, code: Code) -> str:
    first = [number(value) for value in code.start.values()]
    zero_count = code.state - len(first)
    values = [*([f"[{', '.join(first)}]"] if first else []), *([f"[0.0] * {zero_count}"] if zero_count else [])]
    names = f"  # {', '.join(code.start)}{', ...' if zero_count else ''}" if first else ""
    return f"        self.{unit} = {' + '.join(values)}{names}"


def _function(unit: str, code: Code) -> str:
    tables = "".join(f", {k}=({', '.join(number(x) for x in v)},)" for k, v in code.tables.items())
    body = "\n".join(f"    {line}" for line in code.body.split("\n"))
    return f"def _{unit}({'s, ' if code.state else ''}x{tables}):\n{body}"


def _step(program: tuple[Layer, ...], codes: dict[str, Code], u0: np.ndarray, y0: np.ndarray) -> list[str]:
    signals = ["u"] if len(u0) == 1 else [f"u[{i}]" for i in range(len(u0))]
    signals = [f"{u} - ({number(o)})" if o else u for u, o in zip(signals, u0, strict=True)]
    lines = []
    for k, layer in enumerate(program, 1):
        unit = whole(layer)
        if unit is not None:
            lines.append(f"        x{k} = {_call(unit, codes[unit.name], '[' + ', '.join(signals) + ']')}")
            signals = [f"x{k}[{j}]" for j in range(len(layer))]
            continue
        names = [f"x{k}_{j}" for j in range(1, len(layer) + 1)]
        for n, row in zip(names, layer, strict=True):
            terms = [_call(unit, codes[unit.name], signals[i]) for unit, i in row]
            lines.append(f"        {n} = {' + '.join(terms)}")
        signals = names
    ends = [f"{s} + ({number(o)})" if o else s for s, o in zip(signals, y0, strict=True)]
    return [*lines, f"        return {ends[0] if len(ends) == 1 else '[' + ', '.join(ends) + ']'}"]


def _call(unit: Unit, code: Code, x: str) -> str:
    return f"_{unit.name}({f'self.{unit.name}, ' if code.state else ''}{x})"

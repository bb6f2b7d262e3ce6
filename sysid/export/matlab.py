"""A fit as one MATLAB function file, which GNU Octave runs too; needs no toolbox."""

import os
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import write_text
from sysid.block.writing import Code, number
from sysid.export import closed_form
from sysid.export.matlab_text import PICK, RESERVED, matlab
from sysid.export.program import AnyFit, Offset, Program, channel_counts, program
from sysid.model.wiring import Unit, identifier, whole

TAKEN = RESERVED | {"break", "continue", "else", "elseif", "for", "if", "return", "try", "while", PICK}


@checked
def write(fit: AnyFit, path: str | os.PathLike, **scale: Offset) -> Path:
    """Write `source` to a file, complete or not at all; the function has the file's name, as MATLAB wants it."""
    return write_text(path, source(fit, Path(path).stem, **scale))


@checked
def source(fit: AnyFit, name: str = "model", u_offset: Offset = None, y_offset: Offset = None) -> str:
    """Text of `[y, state] = name(u, state)`: the free run of u (N, nu), from a state or, without one, from rest.

    Positions and backlash then start at the fit's initial values, as in `Fit.simulate(u)`. Given one sample and the
    state that came out before, it goes on sample by sample. It takes and gives the levels of raw records: u_offset
    (nu,) and y_offset (ny,) are what was removed from the estimation data, by default as the fit knows it. Raises
    InputError for a block without a formula and a name that is not an identifier.
    """
    identifier(name)
    if name in TAKEN:
        raise InputError(f"{name!r} has a meaning in MATLAB; give another name")
    exported, (n_in, n_out) = program(fit, u_offset, y_offset), channel_counts(fit)
    form = closed_form.text(fit, u_offset=u_offset, y_offset=y_offset).rstrip().split("\n")
    states = [_state(unit, code) for unit, code in exported.codes.items() if code.state]
    parts = [
        "\n".join(
            [
                f"function [y, state] = {name}(u, state)",
                f"%{name.upper()} Exported model, one sample every {fit.Ts:g} s.",
                f"%   y = {name}(u) runs the model over u, one row for each sample, {n_in} column(s); y has {n_out}.",
                f"%   [y, state] = {name}(u, state) goes on from a state, also with a single sample.",
                "%",
                *(f"%   {line}".rstrip() for line in form),
                "    if nargin < 2",
                f"        state = {name}_initial();",
                "    end",
                *(["    u = u(:);"] if n_in == 1 else []),
                f"    y = zeros(size(u, 1), {n_out});",
                "    for t = 1:size(u, 1)",
                f"        [y(t, :), state] = {name}_sample(u(t, :), state);",
                "    end",
                "end",
            ]
        ),
        "\n".join([f"function state = {name}_initial()", "    state = struct();", *states, "end"]),
        "\n".join([f"function [y, state] = {name}_sample(u, state)", *_steps(name, exported), "end"]),
        *(_function(f"{name}_{unit}", code) for unit, code in exported.codes.items()),
    ]
    if any(f"{PICK}(" in part for part in parts[3:]):
        parts.append(_PICK)
    return "\n\n".join(parts) + "\n"


_PICK = f"""function out = {PICK}(test, a, b)
    if test
        out = a;
    else
        out = b;
    end
end"""


def _state(unit: str, code: Code) -> str:
    first = [number(value) for value in code.start.values()]
    names = f"  % {', '.join(code.start)}" if first else ""
    zeros = code.state - len(first)
    values = ", ".join([*first, *([f"zeros(1, {zeros})"] if zeros else [])])
    return f"    state.{unit} = [{values}];{names}"


def _function(unit: str, code: Code) -> str:
    tables = [f"    {k} = [{', '.join(number(x) for x in v)}];" for k, v in code.tables.items()]
    head = f"function [out, s] = {unit}(s, x)" if code.state else f"function out = {unit}(x)"
    return "\n".join([head, *tables, *(f"    {line}" for line in matlab(code.body)), "end"])


def _steps(name: str, exported: Program[Code]) -> list[str]:
    signals = [_minus_offset(f"u({i})", offset) for i, offset in enumerate(exported.u_offset, 1)]
    lines: list[str] = []
    for k, layer in enumerate(exported.layers, 1):
        unit = whole(layer)
        if unit is not None:
            lines.append(_call(name, f"x{k}", unit, exported.codes[unit.name], f"[{', '.join(signals)}]"))
            signals = [f"x{k}({j})" for j in range(1, len(layer) + 1)]
            continue
        names = []
        for j, row in enumerate(layer, 1):
            terms = [f"x{k}_{j}" if len(row) == 1 else f"x{k}_{j}_{i}" for i in range(1, len(row) + 1)]
            for term, (part, i) in zip(terms, row, strict=True):
                lines.append(_call(name, term, part, exported.codes[part.name], signals[i]))
            names.append(terms[0] if len(terms) == 1 else f"({' + '.join(terms)})")
        signals = names
    ends = [_minus_offset(s, -offset) for s, offset in zip(signals, exported.y_offset, strict=True)]
    return [*lines, f"    y = [{', '.join(ends)}];"]


def _minus_offset(signal: str, offset: float) -> str:
    """A signal less an offset, in brackets: in a row, MATLAB takes a - b as one element but a -b as two."""
    value = float(np.abs(offset))
    return signal if value == 0.0 else f"({signal} {'-' if offset > 0 else '+'} {number(value)})"


def _call(name: str, target: str, unit: Unit, code: Code, x: str) -> str:
    if code.state:
        return f"    [{target}, state.{unit.name}] = {name}_{unit.name}(state.{unit.name}, {x});"
    return f"    {target} = {name}_{unit.name}({x});"

"""A fitted chain as one standalone C99 file with a state, init() and step(u) -> y, made from the code of each block."""

import os
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.files import write_text
from sysid.block.writing import Code, number
from sysid.export import closed_form
from sysid.export.program import AnyFit, Offset, channel_counts, program
from sysid.model.wiring import Layer, Unit, identifier, whole


@checked
def write(fit: AnyFit, path: str | os.PathLike, name: str = "model", **scale: Offset) -> Path:
    """Write `source` to a file, complete or not at all."""
    return write_text(path, source(fit, name, **scale))


@checked
def source(fit: AnyFit, name: str = "model", u_offset: Offset = None, y_offset: Offset = None) -> str:
    """C99 text of the fit's free run; it needs nothing but math.h.

    Filters and speeds start from rest, positions and backlash at the fit's initial values (<name>_init), as in
    `Fit.simulate(u)`. It takes and gives the levels of raw records: u_offset (nu,) and y_offset (ny,) are what was
    removed from the estimation data, by default as the fit knows it (`Fit.u_offset`, `Fit.y_offset`). With one input
    and one output `double <name>_step(state, u)`, else `void <name>_step(state, u[], y[])`. Compiled with -D<NAME>_MAIN
    it is a program that reads u from standard input (nu numbers a sample) and prints y. Raises InputError for a block
    without a formula.
    """
    identifier(name)
    whole_fit = program(fit, "c", u_offset, y_offset)
    n_in, n_out = channel_counts(fit)
    codes = whole_fit.codes
    fields = [_field(unit, code) for unit, code in codes.items() if code.state] or ["    char none;"]
    starts = [_start(unit, code) for unit, code in codes.items() if code.start]
    state = f"{name}_state"
    comment = closed_form.text(fit, u_offset=u_offset, y_offset=y_offset).rstrip().replace("*/", "* /")
    parts = [
        "\n".join([f"/* {name}: exported model, C99.", "", *_indent(comment.split("\n")), "*/"]),
        "#include <math.h>",
        f"enum {{ {name}_inputs = {n_in}, {name}_outputs = {n_out} }};",
        f"const double {name}_Ts = {number(fit.Ts)}; /* s */",
        "\n".join([f"typedef struct {{ /* set it with {name}_init */", *fields, f"}} {state};"]),
        *(_function(name, unit, code) for unit, code in codes.items()),
        _init(name, starts),
        _step(name, whole_fit.layers, codes, whole_fit.u_offset, whole_fit.y_offset),
        _main(name, n_in, n_out),
    ]
    return "\n\n".join(parts) + "\n"


def _field(unit: str, code: Code) -> str:
    first = f" /* {', '.join(code.start)}{', ...' if len(code.start) < code.state else ''} */" if code.start else ""
    return f"    double {unit}[{code.state}];{first}"


def _start(unit: str, code: Code) -> str:
    return f".{unit} = {{{_list(np.array(list(code.start.values())))}}}"


def _init(name: str, starts: list[str]) -> str:
    """Members without a value start at zero, as static memory does."""
    values = f" = {{{', '.join(starts)}}}" if starts else ""
    return f"""void {name}_init({name}_state *s)
{{
    static const {name}_state start{values};
    *s = start;
}}"""


def _function(name: str, unit: str, code: Code) -> str:
    tables = [f"    static const double {k}[{len(v)}] = {{{_list(v)}}};" for k, v in code.tables.items()]
    body = [f"    {line}" for line in code.body.split("\n")]
    state = "double *s, " if code.state else ""
    if code.channels != (1, 1):
        head = f"static void {name}_{unit}({state}const double x[{code.channels[0]}], double y[{code.channels[1]}])"
        return "\n".join([head, "{", *tables, *body, "}"])
    return "\n".join([f"static double {name}_{unit}({state}double x)", "{", *tables, *body, "}"])


def _step(name: str, program: tuple[Layer, ...], codes: dict[str, Code], u0: np.ndarray, y0: np.ndarray) -> str:
    single = len(u0) == len(y0) == 1
    signals = ["u" if single else f"u[{i}]" for i in range(len(u0))]
    lines = []
    signals = [f"{u} - ({number(o)})" if o else u for u, o in zip(signals, u0, strict=True)]
    for k, layer in enumerate(program, 1):
        unit = whole(layer)
        if unit is not None:
            place = f"s->{unit.name}, " if codes[unit.name].state else ""
            lines.append(f"    const double v{k}[{len(signals)}] = {{{', '.join(signals)}}};")
            lines.append(f"    double x{k}[{len(layer)}];")
            lines.append(f"    {name}_{unit.name}({place}v{k}, x{k});")
            signals = [f"x{k}[{j}]" for j in range(len(layer))]
            continue
        terms = [[_call(name, unit, codes[unit.name], signals[i]) for unit, i in row] for row in layer]
        names = [f"x{k}_{j}" for j in range(1, len(layer) + 1)]
        lines += [f"    const double {n} = {' + '.join(row)};" for n, row in zip(names, terms, strict=True)]
        signals = names
    ends = [f"{s} + ({number(o)})" if o else s for s, o in zip(signals, y0, strict=True)]
    if not any(code.state for code in codes.values()):
        lines.insert(0, "    (void)s;")
    if single:
        head, lines = f"double {name}_step({name}_state *s, double u)", [*lines, f"    return {ends[0]};"]
    else:
        head = f"void {name}_step({name}_state *s, const double u[{len(u0)}], double y[{len(y0)}])"
        lines += [f"    y[{j}] = {end};" for j, end in enumerate(ends)]
    return "\n".join([head, "{", *lines, "}"])


def _call(name: str, unit: Unit, code: Code, x: str) -> str:
    return f"{name}_{unit.name}({f's->{unit.name}, ' if code.state else ''}{x})"


def _main(name: str, n_in: int, n_out: int) -> str:
    step = f"y[0] = {name}_step(&s, u[0]);" if n_in == n_out == 1 else f"{name}_step(&s, u, y);"
    return f"""#ifdef {name.upper()}_MAIN
#include <stdio.h>
int main(void)
{{
    {name}_state s;
    double u[{n_in}], y[{n_out}];
    int i = 0;
    {name}_init(&s);
    while (scanf("%lf", &u[i]) == 1) {{
        if (++i < {n_in}) continue;
        i = 0;
        {step}
        for (int j = 0; j < {n_out}; ++j) printf(j + 1 < {n_out} ? "%.17g " : "%.17g\\n", y[j]);
    }}
    return 0;
}}
#endif"""


def _indent(text: list[str]) -> list[str]:
    return [f"   {line}".rstrip() for line in text]


def _list(values: np.ndarray) -> str:
    return ", ".join(number(v) for v in values)

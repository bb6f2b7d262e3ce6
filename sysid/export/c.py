"""A fitted chain as one standalone C99 file: a state, init(), step(u) -> y; one line in `EMITTERS` a block."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sysid.base.files import write_text
from sysid.block.block import Block
from sysid.blocks import (
    CubicSpline,
    DeadZone,
    DeadZoneSaturation,
    PiecewiseLinear,
    Polynomial,
    Quantiser,
    Saturation,
    SigmoidNetwork,
    TransferFunction,
    TravelMap,
    UnitGain,
    WaveletNetwork,
)
from sysid.estimation.result import Fit
from sysid.export import closed_form
from sysid.export.motion_c import EMITTERS as MOTION
from sysid.model.wiring import (
    Code,
    Layer,
    Unit,
    arcs,
    break_points,
    cubics,
    entry,
    identifier,
    layers,
    number,
    offsets,
    strokes,
)

# Segment i that x lies in, the outer ones without end, and the share r of the way through it.
_LINES = """int i = 0;
while (i < {last} && KX[i + 1] < x) ++i;
const double r = (x - KX[i]) / (KX[i + 1] - KX[i]);"""


def cubic_spline(block: CubicSpline, theta: np.ndarray) -> Code:
    return _curve(*cubics(block, theta), "{}")


def _curve(lo: float, hi: float, c: np.ndarray, of: str) -> Code:
    """What `of` makes of the curve with coefficients c (m, 4) between lo and hi."""
    m = len(c)
    value = of.format("p[0] + v * (p[1] + v * (p[2] + v * p[3])) + beyond * slope")
    body = f"""const double r = (x - {number(lo)}) / ({number(hi)} - {number(lo)});
const double inside = r < 0.0 ? 0.0 : (r > 1.0 ? 1.0 : r);
int i = 0;
while (i < {m - 1} && inside * {m}.0 >= i + 1) ++i;
const double *p = C + 4 * i;
const double v = inside * {m}.0 - i, beyond = (r - inside) * {m}.0;
const double slope = p[1] + v * (2.0 * p[2] + v * 3.0 * p[3]);
return {value};"""
    return Code(body, tables={"C": c.ravel()})


def dead_zone(block: DeadZone, theta: np.ndarray) -> Code:
    lo, hi = map(number, theta)
    return Code(f"return x < {lo} ? x - ({lo}) : (x > {hi} ? x - ({hi}) : 0.0);")


def dead_zone_saturation(block: DeadZoneSaturation, theta: np.ndarray) -> Code:
    s_lo, d_lo, d_up, s_up, a_lo, a_up = map(number, theta)
    body = f"""if (x < {d_lo}) return {a_lo} * ((x < {s_lo} ? {s_lo} : x) - ({d_lo}));
if (x > {d_up}) return {a_up} * ((x > {s_up} ? {s_up} : x) - ({d_up}));
return 0.0;"""
    return Code(body)


def piecewise_linear(block: PiecewiseLinear, theta: np.ndarray) -> Code:
    x, y = break_points(block, theta)
    return Code(f"{_LINES.format(last=len(x) - 2)}\nreturn KY[i] + r * (KY[i + 1] - KY[i]);", tables={"KX": x, "KY": y})


def polynomial(block: Polynomial, theta: np.ndarray) -> Code:
    body = f"""double y = 0.0;
for (int i = 0; i < {len(theta)}; ++i) y = y * x + C[i];
return y;"""
    return Code(body, tables={"C": theta})


def quantiser(block: Quantiser, theta: np.ndarray) -> Code:
    return Code(f"return {number(block.step)} * floor(x / {number(block.step)} + 0.5);")


def saturation(block: Saturation, theta: np.ndarray) -> Code:
    lo, hi = map(number, theta)
    return Code(f"return x < {lo} ? {lo} : (x > {hi} ? {hi} : x);")


def sigmoid_network(block: SigmoidNetwork, theta: np.ndarray) -> Code:
    n = block.units
    body = f"""double y = {number(theta[0])} + {number(theta[1])} * x;
for (int k = 0; k < {n}; ++k) y += S[k] * (1.0 / (1.0 + exp(-(B[k] * x + C[k]))));
return y;"""
    return Code(body, tables={"S": theta[2 : 2 + n], "B": theta[2 + n : 2 + 2 * n], "C": theta[2 + 2 * n :]})


def transfer_function(block: TransferFunction, theta: np.ndarray) -> Code:
    B, F = block.padded(theta)
    n = block.n_state
    if n == 0:
        return Code(f"return {number(B[0])} * x;")
    # Transposed direct form II in the order of the library's own kernel, so that rounding agrees too.
    body = f"""const double y = s[0] + B[0] * x;
for (int i = 0; i < {n}; ++i) s[i] = s[i + 1] + B[i + 1] * x - F[i] * y;
return y;"""
    return Code(body, n + 1, {"B": B, "F": F[1:]})


def travel_map(block: TravelMap, theta: np.ndarray) -> Code:
    x, s = strokes(block, theta)
    low, way = number(theta[0]), number(theta[1] - theta[0])
    if block.curved:
        return _curve(0.0, 1.0, arcs(block, theta), f"{low} + {way} * ({{}})")
    body = f"{_LINES.format(last=len(x) - 2)}\nreturn {low} + {way} * (KY[i] + r * (KY[i + 1] - KY[i]));"
    return Code(body, tables={"KX": x, "KY": s})


def unit_gain(block: UnitGain, theta: np.ndarray) -> Code:
    return Code("return x;")


def wavelet_network(block: WaveletNetwork, theta: np.ndarray) -> Code:
    n = block.units
    body = f"""double y = {number(theta[0])} + {number(theta[1])} * x;
for (int k = 0; k < {n}; ++k) {{
    const double z = B[k] * (x - C[k]), e = exp(-0.5 * z * z);
    y += S[k] * (k < {block.wavelets} ? (1.0 - z * z) * e : e);
}}
return y;"""
    return Code(body, tables={"S": theta[2 : 2 + n], "B": theta[2 + n : 2 + 2 * n], "C": theta[2 + 2 * n :]})


EMITTERS: dict[type[Block], Callable[..., Code]] = {
    CubicSpline: cubic_spline,
    DeadZone: dead_zone,
    DeadZoneSaturation: dead_zone_saturation,
    PiecewiseLinear: piecewise_linear,
    Polynomial: polynomial,
    Quantiser: quantiser,
    Saturation: saturation,
    SigmoidNetwork: sigmoid_network,
    TransferFunction: transfer_function,
    TravelMap: travel_map,
    UnitGain: unit_gain,
    WaveletNetwork: wavelet_network,
    **MOTION,
}


def write(fit: Fit, path: str | os.PathLike, name: str = "model", **scale: float) -> Path:
    """`source` into a file, whole or not at all."""
    return write_text(path, source(fit, name, **scale))


def source(
    fit: Fit, name: str = "model", u_offset: float | np.ndarray = 0.0, y_offset: float | np.ndarray = 0.0
) -> str:
    """C99 text of the fit's free run; it needs nothing but math.h.

    Filters start from rest, motion (position, speed, rest of a play) where the fit's record began: <name>_init.
    u_offset (nu,) and y_offset (ny,) are what detrending took away (`IOData.u_offset`, `IOData.y_offset`): with them
    the file takes and gives the rig's own scale. With one input and one output `double <name>_step(state, u)`, else
    `void <name>_step(state, u[], y[])`. Compiled with -D<NAME>_MAIN it is a program that reads u from standard input
    (nu numbers a sample) and prints y. Raises InputError for a block without a formula.
    """
    identifier(name)
    wired = layers(fit.model, fit.theta)
    n_in, n_out = fit.model.channels
    codes = {u.name: entry(EMITTERS, u, "C")(u.block, u.theta) for layer in wired for row in layer for u, _ in row}
    fields = [_field(unit, code) for unit, code in codes.items() if code.state] or ["    char none;"]
    starts = [_start(unit, code) for unit, code in codes.items() if code.start]
    state = f"{name}_state"
    comment = closed_form.text(fit).rstrip().replace("*/", "* /")
    parts = [
        "\n".join([f"/* {name}: exported model, C99.", "", *_indented(comment.split("\n")), "*/"]),
        "#include <math.h>",
        f"enum {{ {name}_inputs = {n_in}, {name}_outputs = {n_out} }};",
        f"const double {name}_Ts = {number(fit.Ts)}; /* s */",
        "\n".join([f"typedef struct {{ /* set it with {name}_init */", *fields, f"}} {state};"]),
        *(_function(name, unit, code) for unit, code in codes.items()),
        _init(name, starts),
        _step(name, wired, codes, offsets(u_offset, n_in, "u_offset"), offsets(y_offset, n_out, "y_offset")),
        _main(name, n_in, n_out),
    ]
    return "\n\n".join(parts) + "\n"


def _field(unit: str, code: Code) -> str:
    first = f" /* {', '.join(code.start)}{', ...' if len(code.start) < code.state else ''} */" if code.start else ""
    return f"    double {unit}[{code.state}];{first}"


def _start(unit: str, code: Code) -> str:
    return f".{unit} = {{{_list(np.array(list(code.start.values())))}}}"


def _init(name: str, starts: list[str]) -> str:
    """What has no value of its own begins with zero, as static memory does."""
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
    return "\n".join([f"static double {name}_{unit}({state}double x)", "{", *tables, *body, "}"])


def _step(name: str, wired: tuple[Layer, ...], codes: dict[str, Code], u0: np.ndarray, y0: np.ndarray) -> str:
    single = len(u0) == len(y0) == 1
    signals = ["u" if single else f"u[{i}]" for i in range(len(u0))]
    lines = []
    signals = [f"{u} - ({number(o)})" if o else u for u, o in zip(signals, u0, strict=True)]
    for k, layer in enumerate(wired, 1):
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


def _indented(text: list[str]) -> list[str]:
    return [f"   {line}".rstrip() for line in text]


def _list(values: np.ndarray) -> str:
    return ", ".join(number(v) for v in values)

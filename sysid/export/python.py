"""A fitted chain as one standalone Python file without any import but math; one line in `EMITTERS` a block."""

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
from sysid.export.motion_python import EMITTERS as MOTION
from sysid.model.wiring import Code, Layer, Unit, arcs, break_points, cubics, entry, layers, number, offsets, strokes

# Segment i that x lies in, the outer ones without end, and the share r of the way through it.
_LINES = """i = 0
while i < {last} and KX[i + 1] < x:
    i += 1
r = (x - KX[i]) / (KX[i + 1] - KX[i])"""


def cubic_spline(block: CubicSpline, theta: np.ndarray) -> Code:
    return _curve(*cubics(block, theta), "{}")


def _curve(lo: float, hi: float, c: np.ndarray, of: str) -> Code:
    """What `of` makes of the curve with coefficients c (m, 4) between lo and hi."""
    m = len(c)
    value = of.format(f"p0 + v * (p1 + v * (p2 + v * p3)) + (r - inside) * {m} * slope")
    body = f"""r = (x - {number(lo)}) / ({number(hi)} - {number(lo)})
inside = min(max(r, 0.0), 1.0)
i = min(int(inside * {m}), {m - 1})
p0, p1, p2, p3 = C[4 * i : 4 * i + 4]
v = inside * {m} - i
slope = p1 + v * (2.0 * p2 + v * 3.0 * p3)
return {value}"""
    return Code(body, tables={"C": c.ravel()})


def dead_zone(block: DeadZone, theta: np.ndarray) -> Code:
    return Code(f"return x - min(max(x, {number(theta[0])}), {number(theta[1])})")


def dead_zone_saturation(block: DeadZoneSaturation, theta: np.ndarray) -> Code:
    s_lo, d_lo, d_up, s_up, a_lo, a_up = map(number, theta)
    body = f"""if x < {d_lo}:
    return {a_lo} * (max(x, {s_lo}) - ({d_lo}))
if x > {d_up}:
    return {a_up} * (min(x, {s_up}) - ({d_up}))
return 0.0"""
    return Code(body)


def piecewise_linear(block: PiecewiseLinear, theta: np.ndarray) -> Code:
    x, y = break_points(block, theta)
    return Code(f"{_LINES.format(last=len(x) - 2)}\nreturn KY[i] + r * (KY[i + 1] - KY[i])", tables={"KX": x, "KY": y})


def polynomial(block: Polynomial, theta: np.ndarray) -> Code:
    body = """y = 0.0
for c in C:
    y = y * x + c
return y"""
    return Code(body, tables={"C": theta})


def quantiser(block: Quantiser, theta: np.ndarray) -> Code:
    return Code(f"return {number(block.step)} * math.floor(x / {number(block.step)} + 0.5)")


def saturation(block: Saturation, theta: np.ndarray) -> Code:
    return Code(f"return min(max(x, {number(theta[0])}), {number(theta[1])})")


def sigmoid_network(block: SigmoidNetwork, theta: np.ndarray) -> Code:
    # math.exp overflows beyond 709 where the sigmoid is zero to rounding.
    body = f"""y = {number(theta[0])} + {number(theta[1])} * x
for sk, b, c in zip(S, B, C):
    y += sk * (1.0 / (1.0 + math.exp(min(-(b * x + c), 700.0))))
return y"""
    n = block.units
    return Code(body, tables={"S": theta[2 : 2 + n], "B": theta[2 + n : 2 + 2 * n], "C": theta[2 + 2 * n :]})


def transfer_function(block: TransferFunction, theta: np.ndarray) -> Code:
    B, F = block.padded(theta)
    n = block.n_state
    if n == 0:
        return Code(f"return {number(B[0])} * x")
    body = f"""y = s[0] + B[0] * x
for i in range({n}):
    s[i] = s[i + 1] + B[i + 1] * x - F[i] * y
return y"""
    return Code(body, n + 1, {"B": B, "F": F[1:]})


def travel_map(block: TravelMap, theta: np.ndarray) -> Code:
    x, s = strokes(block, theta)
    low, way = number(theta[0]), number(theta[1] - theta[0])
    if block.curved:
        return _curve(0.0, 1.0, arcs(block, theta), f"{low} + {way} * ({{}})")
    body = f"{_LINES.format(last=len(x) - 2)}\nreturn {low} + {way} * (KY[i] + r * (KY[i + 1] - KY[i]))"
    return Code(body, tables={"KX": x, "KY": s})


def unit_gain(block: UnitGain, theta: np.ndarray) -> Code:
    return Code("return x")


def wavelet_network(block: WaveletNetwork, theta: np.ndarray) -> Code:
    body = f"""y = {number(theta[0])} + {number(theta[1])} * x
for k in range({block.units}):
    z = B[k] * (x - C[k])
    e = math.exp(-0.5 * z * z)
    y += S[k] * ((1.0 - z * z) * e if k < {block.wavelets} else e)
return y"""
    n = block.units
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


def write(fit: Fit, path: str | os.PathLike, **scale: float) -> Path:
    """`source` into a file, whole or not at all."""
    return write_text(path, source(fit, **scale))


def source(fit: Fit, u_offset: float | np.ndarray = 0.0, y_offset: float | np.ndarray = 0.0) -> str:
    """Python text of the fit's free run: class Model with step(u) -> y, and simulate(u) -> list.

    Filters start from rest, motion (position, speed, rest of a play) where the fit's record began: a new Model().
    A sample of several channels is a sequence of numbers. u_offset (nu,) and y_offset (ny,) are what detrending took
    away. Run as a program it reads u from standard input, a sample a line, and prints y. Raises InputError for a block
    without a formula.
    """
    wired = layers(fit.model, fit.theta)
    n_in, n_out = fit.model.channels
    codes = {u.name: entry(EMITTERS, u, "Python")(u.block, u.theta) for layer in wired for row in layer for u, _ in row}
    comment = "\n".join(f"# {line}".rstrip() for line in closed_form.text(fit).rstrip().split("\n"))
    states = [_state(unit, code) for unit, code in codes.items() if code.state]
    begin = "from the fit's first position" if any(code.start for code in codes.values()) else "from rest"
    steps = _step(wired, codes, offsets(u_offset, n_in, "u_offset"), offsets(y_offset, n_out, "y_offset"))
    shown = "model.step(*values)" if n_in == 1 else "model.step(values)"
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
            y = {shown}
            print({"repr(y)" if n_out == 1 else '" ".join(repr(v) for v in y)'})
'''


_newline, _blank2 = "\n", "\n\n\n"


def _state(unit: str, code: Code) -> str:
    first = [number(value) for value in code.start.values()]
    others = code.state - len(first)
    values = [*([f"[{', '.join(first)}]"] if first else []), *([f"[0.0] * {others}"] if others else [])]
    names = f"  # {', '.join(code.start)}{', ...' if others else ''}" if first else ""
    return f"        self.{unit} = {' + '.join(values)}{names}"


def _function(unit: str, code: Code) -> str:
    tables = "".join(f", {k}=({', '.join(number(x) for x in v)},)" for k, v in code.tables.items())
    body = "\n".join(f"    {line}" for line in code.body.split("\n"))
    return f"def _{unit}({'s, ' if code.state else ''}x{tables}):\n{body}"


def _step(wired: tuple[Layer, ...], codes: dict[str, Code], u0: np.ndarray, y0: np.ndarray) -> list[str]:
    signals = ["u"] if len(u0) == 1 else [f"u[{i}]" for i in range(len(u0))]
    signals = [f"{u} - ({number(o)})" if o else u for u, o in zip(signals, u0, strict=True)]
    lines = []
    for k, layer in enumerate(wired, 1):
        names = [f"x{k}_{j}" for j in range(1, len(layer) + 1)]
        for n, row in zip(names, layer, strict=True):
            terms = [_call(unit, codes[unit.name], signals[i]) for unit, i in row]
            lines.append(f"        {n} = {' + '.join(terms)}")
        signals = names
    ends = [f"{s} + ({number(o)})" if o else s for s, o in zip(signals, y0, strict=True)]
    return [*lines, f"        return {ends[0] if len(ends) == 1 else '[' + ', '.join(ends) + ']'}"]


def _call(unit: Unit, code: Code, x: str) -> str:
    return f"_{unit.name}({f'self.{unit.name}, ' if code.state else ''}{x})"

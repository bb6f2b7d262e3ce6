"""The closed form of a fitted chain as text: difference equations with numbers, maps as formulas; a line a block.

Static formulas use * and ^ and the functions min, max, exp, floor, so that they can be pasted into a calculation.
"""

from collections.abc import Callable

import numpy as np

from sysid.block.block import Block, StaticBlock
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
from sysid.export.closed_form_motion import FORMULAS as MOTION
from sysid.model.wiring import Writer, arcs, break_points, cubics, entry, layers, strokes


def cubic_spline(block: CubicSpline, theta: np.ndarray, w: Writer) -> list[str]:
    return _curve(*cubics(block, theta), w)


def _curve(lo: float, hi: float, c: np.ndarray, w: Writer) -> list[str]:
    """A formula for each of the cubics c (m, 4) between lo and hi, and straight lines beyond."""
    edges = np.linspace(lo, hi, len(c) + 1)
    width = (hi - lo) / len(c)
    last = c[-1]
    slopes = (c[0, 1] / width, (last[1] + 2.0 * last[2] + 3.0 * last[3]) / width)
    curves = [w.sum([(c[0, 0], ""), (slopes[0], w.minus(lo))])]
    for piece, edge in zip(c, edges, strict=False):
        step = w.minus(edge)
        powers = [(piece[k] / width**k, "" if k == 0 else step if k == 1 else f"{step}^{k}") for k in range(4)]
        curves.append(w.sum(powers))
    curves.append(w.sum([(float(last.sum()), ""), (slopes[1], w.minus(hi))]))
    return _pieces(edges, curves, w)


def dead_zone(block: DeadZone, theta: np.ndarray, w: Writer) -> list[str]:
    return [f"{w.y} = {w.x} - min(max({w.x}, {w.num(theta[0])}), {w.num(theta[1])})"]


def dead_zone_saturation(block: DeadZoneSaturation, theta: np.ndarray, w: Writer) -> list[str]:
    s_lo, d_lo, d_up, s_up, a_lo, a_up = theta
    curves = [
        w.sum([(a_lo * (s_lo - d_lo), "")]),
        w.sum([(a_lo, w.minus(d_lo))]),
        "0",
        w.sum([(a_up, w.minus(d_up))]),
        w.sum([(a_up * (s_up - d_up), "")]),
    ]
    return _pieces(theta[:4], curves, w)


def piecewise_linear(block: PiecewiseLinear, theta: np.ndarray, w: Writer) -> list[str]:
    return _straight(*break_points(block, theta), w)


def polynomial(block: Polynomial, theta: np.ndarray, w: Writer) -> list[str]:
    n = block.degree
    powers = ["" if k == 0 else w.x if k == 1 else f"{w.x}^{k}" for k in range(n, -1, -1)]
    return [f"{w.y} = {w.sum(list(zip(theta.tolist(), powers, strict=True)))}"]


def quantiser(block: Quantiser, theta: np.ndarray, w: Writer) -> list[str]:
    return [f"{w.y} = {w.num(block.step)}*floor({w.x}/{w.num(block.step)} + 0.5)"]


def saturation(block: Saturation, theta: np.ndarray, w: Writer) -> list[str]:
    return [f"{w.y} = min(max({w.x}, {w.num(theta[0])}), {w.num(theta[1])})"]


def sigmoid_network(block: SigmoidNetwork, theta: np.ndarray, w: Writer) -> list[str]:
    n = block.units
    rows = zip(theta[2 : 2 + n], theta[2 + n : 2 + 2 * n], theta[2 + 2 * n :], strict=True)
    units = [f"  + {w.num(s)}/(1 + exp(-({w.sum([(b, w.x), (c, '')])})))" for s, b, c in rows]
    return [f"{w.y} = {w.sum([(theta[0], ''), (theta[1], w.x)])}", *units]


def transfer_function(block: TransferFunction, theta: np.ndarray, w: Writer) -> list[str]:
    b, f, _ = block.split(theta)
    past = [(-value, f"{w.y}(t-{j})") for j, value in enumerate(f, 1)]
    now = [(value, f"{w.x}(t-{block.nk + i})" if block.nk + i else f"{w.x}(t)") for i, value in enumerate(b)]
    B = w.sum([(value, f"z^-{block.nk + i}" if block.nk + i else "") for i, value in enumerate(b)])
    F = w.sum([(1.0, ""), *((value, f"z^-{j}") for j, value in enumerate(f, 1))])
    return [
        f"{w.y}(t) = {w.sum(now + past)}",
        f"  B(z) = {B}",
        f"  F(z) = {F}",
        f"  poles {_roots(block.poles(theta))}; zeros {_roots(block.zeros(theta))}; "
        f"gain at rest {block.gain(theta):.6g}",
    ]


def travel_map(block: TravelMap, theta: np.ndarray, w: Writer) -> list[str]:
    x, s = strokes(block, theta)
    if block.curved:
        return _curve(0.0, 1.0, (theta[1] - theta[0]) * arcs(block, theta) + [theta[0], 0.0, 0.0, 0.0], w)
    return _straight(x, theta[0] + (theta[1] - theta[0]) * s, w)


def unit_gain(block: UnitGain, theta: np.ndarray, w: Writer) -> list[str]:
    return [f"{w.y} = {w.x}"]


def wavelet_network(block: WaveletNetwork, theta: np.ndarray, w: Writer) -> list[str]:
    n = block.units
    lines = [f"{w.y} = {w.sum([(theta[0], ''), (theta[1], w.x)])}"]
    for k, (s, b, c) in enumerate(zip(theta[2 : 2 + n], theta[2 + n : 2 + 2 * n], theta[2 + 2 * n :], strict=True)):
        square = f"({w.num(b)}*{w.minus(c)})^2"
        factor = f"(1 - {square})*" if k < block.wavelets else ""
        lines.append(f"  + {w.num(s)}*{factor}exp(-0.5*{square})")
    return lines


FORMULAS: dict[type[Block], Callable[..., list[str]]] = {
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


def text(fit: Fit, digits: int | None = 6) -> str:
    """The fit as formulas from u to y, one block after the other; digits=None writes every number exactly.

    t counts samples; what stands before the record is not part of the model and is left out. Raises InputError for a
    block that is a function of the user's own.
    """
    lines = [f"{fit.model.structure}, one sample every {fit.Ts:g} s"]
    wired = layers(fit.model, fit.theta)
    names, signals = _signals(fit), _channels("u", fit.model.channels[0])
    for block, layer, name in zip(fit.model.blocks, wired, names, strict=True):
        outputs = _channels(name, len(layer))
        lines += ["", f"{block.role}:"]
        for output, units in zip(outputs, layer, strict=True):
            alone = len(units) == 1
            for unit, i in units:
                y = output if alone else f"{output}_{signals[i]}"
                lines += entry(FORMULAS, unit, "text")(unit.block, unit.theta, Writer(signals[i], y, digits))
            if not alone:
                lines.append(f"{output} = " + " + ".join(f"{output}_{signals[i]}" for _, i in units))
        signals = outputs
    return "\n".join(lines) + "\n"


def _signals(fit: Fit) -> list[str]:
    """Names of each block's output: w after a map, x after a filter, y at the end, numbered where they repeat."""
    names: list[str] = []
    for block in fit.model.blocks[:-1]:
        static = all(isinstance(part, StaticBlock) for _, part in block.parts())
        letter = "w" if static else "x"
        count = sum(n.startswith(letter) for n in names)
        names.append(f"{letter}_{count + 1}" if count else letter)
    return [*names, "y"]


def _channels(name: str, n: int) -> list[str]:
    return [name] if n == 1 else [f"{name}{i}" for i in range(1, n + 1)]


def _pieces(edges: np.ndarray, curves: list[str], w: Writer) -> list[str]:
    """A formula for each piece between the edges, the first and the last without end."""
    lines = []
    for i, curve in enumerate(curves):
        above = f"{w.num(edges[i - 1])} < " if i > 0 else ""
        below = f" <= {w.num(edges[i])}" if i < len(edges) else ""
        where = f"   where {above}{w.x}{below}" if above or below else ""
        lines.append(f"{w.y} = {curve}{where}")
    return lines


def _straight(x: np.ndarray, y: np.ndarray, w: Writer) -> list[str]:
    """Straight lines through the points (x, y), the outer ones without end."""
    slopes = np.diff(y) / np.diff(x)
    curves = [w.sum([(y[i], ""), (slopes[i], w.minus(x[i]))]) for i in range(len(slopes))]
    return _pieces(x[1:-1], curves, w)


def _roots(roots: np.ndarray) -> str:
    if not len(roots):
        return "none"
    shown = []
    for z in roots:
        if abs(z.imag) < 1e-12:
            shown.append(f"{z.real:.6g}")
        elif z.imag > 0:
            shown.append(f"{z.real:.6g} +- {z.imag:.6g}i")
    return ", ".join(shown)

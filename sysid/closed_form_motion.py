"""Closed form of the blocks with a memory that are not linear: equations with their switches, in symbols and words.

Time is in samples. An equation in v' is solved exactly between its switches, not by a difference. As with filters,
what stands before the record is left out: first positions and speeds, and a play's rest.
"""

import math
from collections.abc import Callable

import numpy as np

from sysid.block import Block
from sysid.blocks import CoastingPlay, Delay, FrictionLag, LimitedIntegrator, Motor, ProfiledMotor
from sysid.wiring import Writer, by_name


def delay(block: Delay, theta: np.ndarray, w: Writer) -> list[str]:
    whole = math.floor(theta[0])
    late = float(theta[0]) - whole
    now, before = f"{w.x}(t-{whole})" if whole else f"{w.x}(t)", f"{w.x}(t-{whole + 1})"
    return [f"{w.y}(t) = {w.sum([(1.0 - late, now), (late, before)])}"]


def friction_lag(block: FrictionLag, theta: np.ndarray, w: Writer) -> list[str]:
    gain, drag, friction, onset, _ = theta.tolist()
    rate = w.sum([(gain, w.x), (-drag, w.y), (-friction, f"tanh({w.y}/{w.num(onset)})")])
    return [
        f"{w.y}' = {rate}, time in samples",
        f"  {w.x} is held over each sample; midpoint rule in {block.substeps} equal parts of it",
    ]


def limited_integrator(block: LimitedIntegrator, theta: np.ndarray, w: Writer) -> list[str]:
    gain, lower, upper, _ = theta.tolist()
    step = w.sum([(1.0, f"{w.y}(t-1)"), (gain, f"{w.x}(t-1)")])
    return [f"{w.y}(t) = min(max({step}, {w.num(lower)}), {w.num(upper)})"]


def coasting_play(block: CoastingPlay, theta: np.ndarray, w: Writer) -> list[str]:
    width, _, drag, pull, slope = theta.tolist()
    low, high = f"{w.x}(t) - {w.num(0.5 * width)}", f"{w.x}(t) + {w.num(0.5 * width)}"
    return [
        f"v' = -P - {w.num(drag)}*sign(v), {w.y}' = v, time in samples, while {low} <= {w.y}(t) <= {high}",
        f"  P = {w.sum([(pull, ''), (slope, w.y)])}",
        f"  v stays 0 where |P| <= {w.num(drag)}",
        f"  {w.y}(t) = {low} where it would be less, {high} where more; there v = {w.x}(t) - {w.x}(t-1)",
        _exact("P" if slope else "", 1, "sample"),
    ]


def motor(block: Motor, theta: np.ndarray, w: Writer) -> list[str]:
    m = by_name(block, theta)
    away = f"({w.sum([(1.0, w.y), (-block.at, '')])})"
    net = f"{w.x} - L" if block.load else w.x
    load = [(m[f"load{i}"], ["", away, f"{away}^2"][i]) for i in range(block.load)]
    extra = [f"{w.num(m['stick'])}*exp(-(v/{w.num(m['stick_speed'])})^2)"] if block.stribeck else []
    extra += [f"{w.num(m['loss'])}*|L|"] if block.loss else []
    up = w.num(m["rise"]) + (" + R" if extra else "")
    down = f"-({w.num(m['fall'])} + R)" if extra else w.num(-m["fall"])
    ends = f"  {w.y} ends at {w.num(m['lower'])} and at {w.num(m['upper'])}, where v becomes 0" if block.stops else ""
    ends += f" and stays 0 for a time {w.num(m['jam'])}*|v| after a blow at speed v" if block.jams else ""
    loss_varies = block.loss and block.load > 1
    varies = [name for name, does in (("L", block.load > 1), ("R", block.stribeck or loss_varies)) if does]
    lines = [
        f"{w.num(m['lag'])}*v' + v = {w.num(m['gain'])}*({net} - F), {w.y}' = v, time in samples",
        f"  L = {w.sum(load)}" if load else "",
        f"  R = {' + '.join(extra)}" if extra else "",
        f"  F = {up} where v > 0, F = {down} where v < 0",
        f"  v stays 0 where {down} <= {net} <= {up}",
        ends,
        f"  {w.x} is held for one sample" + (f" and acts {w.num(m['delay'])} samples late" if m.get("delay") else ""),
        _exact(" and ".join(varies), block.substeps),
    ]
    return [line for line in lines if line]


def profiled_motor(block: ProfiledMotor, theta: np.ndarray, w: Writer) -> list[str]:
    m, (rise, fall) = by_name(block, theta), block.profiles(theta)
    up, down = w.num(m["drag_up"]), w.num(m["drag_down"])
    places = np.linspace(block.low, block.high, block.knots) if block.knots > 1 else np.array([block.low])
    return [
        f"{w.num(m['inertia'])}*v' = {w.x} - D*v - F, {w.y}' = v, time in samples",
        f"  D = {up}, F = rise({w.y}) where v > 0; D = {down}, F = -fall({w.y}) where v < 0",
        f"  v stays 0 where -fall({w.y}) <= {w.x} <= rise({w.y})",
        f"  rise and fall are straight between these values, constant beyond, at {w.y} = {_list(places, w)}:",
        f"  rise = {_list(rise, w)}",
        f"  fall = {_list(fall, w)}",
        f"  {w.x} is held for one sample",
        _exact("F" if block.knots > 1 else "", block.substeps),
    ]


def _exact(frozen: str, substeps: int, held: str = "held input") -> str:
    """How the motion is solved, and what is taken for constant meanwhile."""
    solved = "  between these switches the motion is solved exactly"
    stretch = f"each {held}" if substeps == 1 else f"each of {substeps} equal parts of a {held}"
    return f"{solved}, {frozen} from the start of {stretch}" if frozen else solved


def _list(values: np.ndarray, w: Writer) -> str:
    return ", ".join(w.num(v) for v in values)


FORMULAS: dict[type[Block], Callable[..., list[str]]] = {}

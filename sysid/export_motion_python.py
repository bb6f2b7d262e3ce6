"""Python of the blocks with a memory that are not linear: the recursions of the kernels, without their sensitivities.

Operations stand in the kernels' order, so that rounding agrees too. What a block does not have is left out.
"""

import math
from collections.abc import Callable

import numpy as np

from sysid.block import Block
from sysid.blocks import CoastingPlay, Delay, FrictionLag, LimitedIntegrator, Motor, ProfiledMotor
from sysid.wiring import EVENTS, SHORTEST, Code, arrivals, by_name, number

# First-order lag towards `speed` over a time h, or up to the turn where speed passes zero on the way.
_LAG = [
    "decay = math.exp(-h / lag)",
    "after = speed + (v - speed) * decay",
    "turns = v != 0.0 and after * sign < 0.0",
    "span = lag * math.log(1.0 - v / speed) if turns else h",
    "if turns:",
    "    decay, after = speed / (speed - v), 0.0",
    "p += speed * span + (v - speed) * (lag * (1.0 - decay))",
    "v = after",
    "h -= span",
]
_SIGN = "sign = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)"
_AGAIN = [f"if not turns or h <= {SHORTEST}:", "    break"]
# What is left of the time that a stop keeps the motor, and of h.
_JAMMED = ["kept = min(jammed, h)", "jammed, h = jammed - kept, h - kept", f"if h <= {SHORTEST}:", "    continue"]


def delay(block: Delay, theta: np.ndarray) -> Code:
    whole = math.floor(theta[0])
    late = float(theta[0]) - whole
    before, after = _past(0, whole + 1)
    value = f"y = {number(1.0 - late)} * {_old(1, whole)} + {number(late)} * {_old(1, whole + 1)}"
    return Code("\n".join([*before, value, *after, "return y"]), whole + 2)


def friction_lag(block: FrictionLag, theta: np.ndarray) -> Code:
    gain, drag, friction, onset, _ = map(number, theta)
    h, half = number(1.0 / block.substeps), number(0.5 * (1.0 / block.substeps))
    body = f"""y = v = s[0]
for _ in range({block.substeps}):
    middle = v + {half} * ({gain} * x - {drag} * v - {friction} * math.tanh(v / {onset}))
    v += {h} * ({gain} * x - {drag} * middle - {friction} * math.tanh(middle / {onset}))
s[0] = v
return y"""
    return Code(body, 1, start={"speed": float(theta[4])})


def limited_integrator(block: LimitedIntegrator, theta: np.ndarray) -> Code:
    gain, lower, upper, start = map(float, theta)
    body = f"""y = s[0]
s[0] = min(max(y + {number(gain)} * x, {number(lower)}), {number(upper)})
return y"""
    return Code(body, 1, start={"position": min(max(start, lower), upper)})


def coasting_play(block: CoastingPlay, theta: np.ndarray) -> Code:
    """Kept: output, its speed, the input before, and whether there is one."""
    width, _, drag, pull, slope = map(number, theta)
    half = number(0.5 * theta[0])
    body = f"""y, v, before, begun = s
if not begun:
    s[:] = x + y * {width}, 0.0, x, 1.0
    return s[0]
pull, h = {pull} + {slope} * y, 1.0
for _ in range(2):  # free flight: it may come to rest and fall the other way
    {_SIGN}
    if sign == 0.0 and abs(pull) > {drag}:
        sign = -1.0 if pull > 0.0 else 1.0
    if sign == 0.0:  # its bearing holds it
        break
    rate = -pull - {drag} * sign
    rests = v != 0.0 and (v + rate * h) * sign < 0.0
    span = -v / rate if rests else h
    y += (v + 0.5 * rate * span) * span
    v = 0.0 if rests else v + rate * span
    if not rests:
        break
    h -= span
low, high = x - {half}, x + {half}
if y < low or y > high:  # a side takes it along
    y, v = (low if y < low else high), x - before
s[:3] = y, v, x
return y"""
    return Code(body, 4, start={"rest, later the output": float(theta[1])})


def motor(block: Motor, theta: np.ndarray) -> Code:
    m, stretches = by_name(block, theta), arrivals(block, theta)
    oldest, own = max(age for age, _ in stretches), 3 if block.jams else 2
    before, after = _past(own, oldest) if oldest else ([], [])
    n, kept = block.substeps, "p, v, jammed" if block.jams else "p, v"
    times = [(_old(own + 1, age), number(length / n)) for age, length in stretches]
    rows = [f"[({w}, {h})]" + (f" * {n}" if n > 1 else "") for w, h in times]
    lines = [
        f"{kept} = s[:{own}]",
        "y = p",
        *before,
        f"for w, h in {' + '.join(rows)}:",
        *(_inner(1, _JAMMED) if block.jams else []),
        f"    for _ in range({EVENTS}):",
        *_inner(2, [*_speed(block, m), *_LAG, *(_stop(block, m) if block.stops else []), *_AGAIN]),
        *after,
        f"s[:{own}] = {kept}",
        "return y",
    ]
    return Code("\n".join(lines), own + 1 + oldest if oldest else own, start={"position": m["x0"], "speed": m["v0"]})


def _speed(block: Motor, m: dict[str, float]) -> list[str]:
    """What the load and dry friction leave: direction of motion, lag, and the speed that the motor tends to."""
    n = {name: number(value) for name, value in m.items()}
    load = [n[f"load{i}"] + " * away" * i for i in range(block.load)]
    net = "w - L" if block.load else "w"
    stick, held = [n["stick"]] if block.stribeck else [], ["held"] if block.loss else []
    up, down = (" + ".join([n[side], *stick, *held]) for side in ("rise", "fall"))
    below, above = (f" and p < {n['upper']}", f" and p > {n['lower']}") if block.stops else ("", "")
    curve = [f"{n['stick']} * math.exp(-ratio * ratio)"] if block.stribeck else []
    friction = " + ".join([f"({n['rise']} if sign > 0.0 else {n['fall']})", *curve, *held])
    return [
        *([f"away = p - {number(block.at)}"] if block.load > 1 else []),
        *([f"L = {' + '.join(load)}"] if block.load else []),
        *([f"held = {n['loss']} * abs(L)"] if block.loss else []),
        _SIGN,
        f"if sign == 0.0 and {net} > {up}{below}:",
        "    sign = 1.0",
        f"elif sign == 0.0 and {net} < -({down}){above}:",
        "    sign = -1.0",
        "if sign == 0.0:  # friction or a stop holds it",
        "    break",
        *([f"ratio = v / {n['stick_speed']}"] if block.stribeck else []),
        f"F = {friction}",
        f"lag, speed = {n['lag']}, {n['gain']} * ({net} - sign * F)",
    ]


def _stop(block: Motor, m: dict[str, float]) -> list[str]:
    """The end stops take the speed away, and may jam the motor; one that it is leaving lets it go."""
    lo, hi, middle = (number(v) for v in (m["lower"], m["upper"], 0.5 * (m["upper"] + m["lower"])))
    stop = f"{hi} if p >= {hi} else {lo}"
    jam = [
        f"    stop = {stop}",
        f"    jammed = max({number(m.get('jam', 0.0))} * abs(v) - (p - stop) / v, 0.0) if v != 0.0 else 0.0",
        "    p, v = stop, 0.0",
    ]
    return [
        f"if p > {hi} or p < {lo} or (p in ({lo}, {hi}) and v * (p - {middle}) > 0.0):",
        *(jam if block.jams else [f"    p, v = {stop}, 0.0"]),
    ]


def profiled_motor(block: ProfiledMotor, theta: np.ndarray) -> Code:
    m, (rise, fall) = by_name(block, theta), block.profiles(theta)
    per = (block.knots - 1) / (block.high - block.low)
    level = "{0}[i] + share * ({0}[i + 1] - {0}[i])" if block.knots > 1 else "{0}[0]"
    place = [
        f"place = (p - {number(block.low)}) * {number(per)}",
        f"i = int(min(max(place, 0.0), {number(block.knots - 2)}))",
        "share = min(max(place - i, 0.0), 1.0)",
    ]
    part = [
        *(place if block.knots > 1 else []),
        f"up, down = {level.format('RISE')}, {level.format('FALL')}",
        _SIGN,
        "if sign == 0.0:",
        "    sign = 1.0 if x > up else (-1.0 if x < -down else 0.0)",
        "if sign == 0.0:  # friction holds it",
        "    break",
        f"drag = {number(m['drag_up'])} if sign > 0.0 else {number(m['drag_down'])}",
        f"lag, speed = {number(m['inertia'])} / drag, (x - sign * (up if sign > 0.0 else down)) / drag",
        *_LAG,
        *_AGAIN,
    ]
    lines = [
        "p, v = s",
        "y = p",
        f"for h in [{number(1.0 / block.substeps)}] * {block.substeps}:",
        f"    for _ in range({EVENTS}):",
        *_inner(2, part),
        "s[:] = p, v",
        "return y",
    ]
    tables = {"RISE": rise, "FALL": fall}
    return Code("\n".join(lines), 2, tables, {"position": m["x0"], "speed": m["v0"]})


def _old(first: int, age: int) -> str:
    """The input `age` samples ago; the one before the present one stands in s[first]."""
    return f"s[{first + age - 1}]" if age else "x"


def _past(flag: int, oldest: int) -> tuple[list[str], list[str]]:
    """Lines before and after the use of the inputs up to `oldest` samples ago; s[flag] says that there are any."""
    first = flag + 1
    return [
        f"if not s[{flag}]:  # before the first sample its input stood",
        f"    s[{flag}:] = [1.0] + [x] * {oldest}",
    ], [f"s[{first}:] = [x] + s[{first}:-1]"]


def _inner(depth: int, lines: list[str]) -> list[str]:
    return ["    " * depth + line for line in lines]


EMITTERS: dict[type[Block], Callable[..., Code]] = {}

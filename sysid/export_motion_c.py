"""C99 of the blocks with a memory that are not linear: the recursions of the kernels, without their sensitivities.

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
    "double decay = exp(-h / lag), after = speed + (v - speed) * decay;",
    "const int turns = v != 0.0 && after * sign < 0.0;",
    "const double span = turns ? lag * log(1.0 - v / speed) : h;",
    "if (turns) { decay = speed / (speed - v); after = 0.0; }",
    "p += speed * span + (v - speed) * (lag * (1.0 - decay));",
    "v = after;",
    "h -= span;",
]
# What is left of the time that a stop keeps the motor, and of h.
_JAMMED = ["const double kept = jammed < h ? jammed : h;", "jammed -= kept;", "h -= kept;"]
_SIGN = "double sign = v > 0.0 ? 1.0 : (v < 0.0 ? -1.0 : 0.0);"


def delay(block: Delay, theta: np.ndarray) -> Code:
    whole = math.floor(theta[0])
    late = float(theta[0]) - whole
    before, after = _past(0, whole + 1)
    value = f"const double y = {number(1.0 - late)} * {_old(1, whole)} + {number(late)} * {_old(1, whole + 1)};"
    return Code("\n".join([*before, value, *after, "return y;"]), whole + 2)


def friction_lag(block: FrictionLag, theta: np.ndarray) -> Code:
    gain, drag, friction, onset, _ = map(number, theta)
    h, half = number(1.0 / block.substeps), number(0.5 * (1.0 / block.substeps))
    body = f"""const double y = s[0];
for (int part = 0; part < {block.substeps}; ++part) {{
    const double v = s[0];
    const double middle = v + {half} * ({gain} * x - {drag} * v - {friction} * tanh(v / {onset}));
    s[0] = v + {h} * ({gain} * x - {drag} * middle - {friction} * tanh(middle / {onset}));
}}
return y;"""
    return Code(body, 1, start={"speed": float(theta[4])})


def limited_integrator(block: LimitedIntegrator, theta: np.ndarray) -> Code:
    gain, lower, upper, start = map(float, theta)
    lo, hi = number(lower), number(upper)
    body = f"""const double y = s[0], next = y + {number(gain)} * x;
s[0] = next > {hi} ? {hi} : (next < {lo} ? {lo} : next);
return y;"""
    return Code(body, 1, start={"position": min(max(start, lower), upper)})


def coasting_play(block: CoastingPlay, theta: np.ndarray) -> Code:
    """Kept: output, its speed, the input before, and whether there is one."""
    width, _, drag, pull, slope = map(number, theta)
    half = number(0.5 * theta[0])
    body = f"""if (s[3] == 0.0) {{
    s[0] = x + s[0] * {width};
    s[2] = x;
    s[3] = 1.0;
    return s[0];
}}
const double pull = {pull} + {slope} * s[0];
double y = s[0], v = s[1], h = 1.0;
for (int turn = 0; turn < 2; ++turn) {{ /* free flight: it may come to rest and fall the other way */
    {_SIGN}
    if (sign == 0.0 && fabs(pull) > {drag}) sign = pull > 0.0 ? -1.0 : 1.0;
    if (sign == 0.0) break; /* its bearing holds it */
    const double rate = -pull - {drag} * sign;
    const int rests = v != 0.0 && (v + rate * h) * sign < 0.0;
    const double span = rests ? -v / rate : h;
    y += (v + 0.5 * rate * span) * span;
    v = rests ? 0.0 : v + rate * span;
    if (!rests) break;
    h -= span;
}}
const double low = x - {half}, high = x + {half};
if (y < low || y > high) {{ /* a side takes it along */
    y = y < low ? low : high;
    v = x - s[2];
}}
s[0] = y;
s[1] = v;
s[2] = x;
return y;"""
    return Code(body, 4, start={"rest, later the output": float(theta[1])})


def motor(block: Motor, theta: np.ndarray) -> Code:
    m, stretches = by_name(block, theta), arrivals(block, theta)
    oldest, own = max(age for age, _ in stretches), 3 if block.jams else 2
    before, after = _past(own, oldest) if oldest else ([], [])
    (first, long), (last, short), n = stretches[0], stretches[-1], block.substeps
    inputs, times = [_old(own + 1, first), _old(own + 1, last)], [number(long / n), number(short / n)]
    lines = [
        "const double y = s[0];",
        f"double p = s[0], v = s[1]{', jammed = s[2]' if block.jams else ''};",
        *before,
        f"for (int part = 0; part < {len(stretches) * n}; ++part) {{",
        f"    const double w = {_either(inputs, n)};",
        f"    double h = {_either(times, n)};",
        *(_inner(1, _JAMMED) if block.jams else []),
        f"    for (int turn = 0; turn < {EVENTS} && h > {SHORTEST}; ++turn) {{",
        *_inner(2, [*_speed(block, m), *_LAG, *(_stop(block, m) if block.stops else []), "if (!turns) break;"]),
        "    }",
        "}",
        *after,
        "s[0] = p;",
        "s[1] = v;",
        *(["s[2] = jammed;"] if block.jams else []),
        "return y;",
    ]
    return Code("\n".join(lines), own + 1 + oldest if oldest else own, start={"position": m["x0"], "speed": m["v0"]})


def _speed(block: Motor, m: dict[str, float]) -> list[str]:
    """What the load and dry friction leave: direction of motion, lag, and the speed that the motor tends to."""
    n = {name: number(value) for name, value in m.items()}
    load = [f"({n[f'load{i}']})" + " * from" * i for i in range(block.load)]
    net = "w - L" if block.load else "w"
    stick, held = [n["stick"]] if block.stribeck else [], ["held"] if block.loss else []
    up, down = (" + ".join([n[side], *stick, *held]) for side in ("rise", "fall"))
    below, above = (f" && p < {n['upper']}", f" && p > {n['lower']}") if block.stops else ("", "")
    curve = [f"{n['stick']} * exp(-ratio * ratio)"] if block.stribeck else []
    friction = " + ".join([f"(sign > 0.0 ? {n['rise']} : {n['fall']})", *curve, *held])
    return [
        *([f"const double from = p - ({number(block.at)});"] if block.load > 1 else []),
        *([f"const double L = {' + '.join(load)};"] if block.load else []),
        *([f"const double held = {n['loss']} * fabs(L);"] if block.loss else []),
        _SIGN,
        f"if (sign == 0.0 && {net} > {up}{below}) sign = 1.0;",
        f"else if (sign == 0.0 && {net} < -({down}){above}) sign = -1.0;",
        "if (sign == 0.0) break; /* friction or a stop holds it */",
        *([f"const double ratio = v / {n['stick_speed']};"] if block.stribeck else []),
        f"const double F = {friction};",
        f"const double lag = {n['lag']}, speed = {n['gain']} * ({net} - sign * F);",
    ]


def _stop(block: Motor, m: dict[str, float]) -> list[str]:
    """The end stops take the speed away, and may jam the motor; one that it is leaving lets it go."""
    lo, hi, middle = (number(v) for v in (m["lower"], m["upper"], 0.5 * (m["upper"] + m["lower"])))
    jam = [
        f"    const double since = v != 0.0 ? (p - (p >= {hi} ? {hi} : {lo})) / v : 0.0;",
        f"    jammed = {number(m.get('jam', 0.0))} * fabs(v) - since;",
        "    if (jammed < 0.0) jammed = 0.0;",
    ]
    return [
        f"const int beyond = p > {hi} || p < {lo};",
        f"if (beyond || ((p == {hi} || p == {lo}) && v * (p - ({middle})) > 0.0)) {{",
        *(jam if block.jams else []),
        f"    p = p >= {hi} ? {hi} : {lo};",
        "    v = 0.0;",
        "}",
    ]


def profiled_motor(block: ProfiledMotor, theta: np.ndarray) -> Code:
    m, (rise, fall) = by_name(block, theta), block.profiles(theta)
    per = (block.knots - 1) / (block.high - block.low)
    level = "{0}[i] + share * ({0}[i + 1] - {0}[i])" if block.knots > 1 else "{0}[0]"
    place = [
        f"const double place = (p - ({number(block.low)})) * {number(per)};",
        "int i = 0;",
        f"while (i < {block.knots - 2} && place >= i + 1) ++i;",
        "const double share = place < i ? 0.0 : (place > i + 1 ? 1.0 : place - i);",
    ]
    part = [
        *(place if block.knots > 1 else []),
        f"const double up = {level.format('RISE')}, down = {level.format('FALL')};",
        _SIGN,
        "if (sign == 0.0) sign = x > up ? 1.0 : (x < -down ? -1.0 : 0.0);",
        "if (sign == 0.0) break; /* friction holds it */",
        f"const double drag = sign > 0.0 ? {number(m['drag_up'])} : {number(m['drag_down'])};",
        f"const double lag = {number(m['inertia'])} / drag;",
        "const double speed = (x - sign * (sign > 0.0 ? up : down)) / drag;",
        *_LAG,
        "if (!turns) break;",
    ]
    lines = [
        "const double y = s[0];",
        "double p = s[0], v = s[1];",
        f"for (int part = 0; part < {block.substeps}; ++part) {{",
        f"    double h = {number(1.0 / block.substeps)};",
        f"    for (int turn = 0; turn < {EVENTS} && h > {SHORTEST}; ++turn) {{",
        *_inner(2, part),
        "    }",
        "}",
        "s[0] = p;",
        "s[1] = v;",
        "return y;",
    ]
    tables = {"RISE": rise, "FALL": fall}
    return Code("\n".join(lines), 2, tables, {"position": m["x0"], "speed": m["v0"]})


def _old(first: int, age: int) -> str:
    """The input `age` samples ago; the one before the present one stands in s[first]."""
    return f"s[{first + age - 1}]" if age else "x"


def _past(flag: int, oldest: int) -> tuple[list[str], list[str]]:
    """Lines before and after the use of the inputs up to `oldest` samples ago; s[flag] says that there are any."""
    first, last = flag + 1, flag + oldest
    return [
        f"if (s[{flag}] == 0.0) {{ /* before the first sample its input stood */",
        f"    for (int i = {first}; i <= {last}; ++i) s[i] = x;",
        f"    s[{flag}] = 1.0;",
        "}",
    ], [f"for (int i = {last}; i > {first}; --i) s[i] = s[i - 1];", f"s[{first}] = x;"]


def _either(texts: list[str], n: int) -> str:
    """The first text for the first n parts of a sample, the second for the others."""
    return texts[0] if texts[0] == texts[1] else f"part < {n} ? {texts[0]} : {texts[1]}"


def _inner(depth: int, lines: list[str]) -> list[str]:
    return ["    " * depth + line for line in lines]


EMITTERS: dict[type[Block], Callable[..., Code]] = {}

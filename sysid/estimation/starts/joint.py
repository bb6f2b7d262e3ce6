"""Starts of a motor-driven joint from the record: ends, speed per volt, friction, lag, load, and a link's spring."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from sysid.block.block import Block
from sysid.blocks import Compliance, Motor, Play, Travel
from sysid.data.record import IOData
from sysid.estimation.joint_parts import differ_in_motor, free_run_cost, motor_of
from sysid.estimation.starts._start import Start, clip_to_bounds, longest
from sysid.model.chain import Chain

# Chosen by hand.
_TRIED = 150  # candidates a start that is asked for
_AROUND = 3  # candidates with the same balance of voltages
_LINKS = ((0.05, 0.02), (2.5, 1.0))  # least and largest frequency and damping of a link on a spring
_EDGE = 0.002  # of the samples that noise may throw beyond an end
_WINDOWS = (400, 150, 50)  # windows a record: few where the output is noisy, many where it is clean
_DELAYS = (0, 1, 2, 4)  # whole samples
_NEAR = 0.02  # of the range: beside an end a stop may hold the motor


@dataclass(frozen=True)
class _Record:
    """Properties of a record before any model: range of y, its speed at large inputs, its noise."""

    u: np.ndarray
    y: np.ndarray
    low: float
    high: float
    speed: float  # of y per sample, where it moves
    volts: float  # of the input there
    sign: float


class Joint(Start):
    """A chain with a motor: the best of many random candidates in free run, then candidates that differ from it.

    A candidate is friction, asymmetry, load and lag; the speed per volt follows from the measured speeds. A free run
    takes a fraction of a millisecond, and the cost of a motor has too many local minima for one good guess.
    """

    blocks = (Motor,)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record = longest(data)
        properties = _read(record.u[:, 0], record.y[:, 0])
        rng = np.random.default_rng([seed, 7])
        draws = [_draw(chain, properties, rng, k) for k in range(_TRIED * count)]
        draws += [
            _fill_values(chain, motor, properties, rng)
            for motor in _balance_candidates(chain, properties)
            for _ in range(_AROUND)
        ]
        costs = np.array([free_run_cost(chain, theta, properties.u, properties.y) for theta in draws])
        order = np.argsort(costs, kind="stable")
        distinct: list[np.ndarray] = []
        for k in order:
            if all(differ_in_motor(chain, draws[k], earlier) for earlier in distinct):
                distinct.append(draws[k])
            if len(distinct) == count:
                break
        return distinct + [draws[k] for k in order[: count - len(distinct)]]


def _balance_candidates(chain: Chain, properties: _Record) -> list[dict[str, float]]:
    """The motor by its voltage balance where its position is the output but for the ends of a play or a spring."""
    motor = motor_of(chain)
    blocks = chain.blocks[chain.blocks.index(motor) + 1 :]
    if motor is not chain.blocks[0] or not all(isinstance(b, Play | Compliance) for b in blocks) or properties.sign < 0:
        return []
    return balances(motor, properties.u, properties.y, (properties.low, properties.high))


def _fill_values(chain: Chain, values: dict[str, float], properties: _Record, rng: np.random.Generator) -> np.ndarray:
    """A candidate with these values of the motor."""
    theta, motor = _draw(chain, properties, rng, 1), motor_of(chain)
    part = dict(zip([slot.name for slot in motor.slots()], chain.part(theta, motor), strict=True)) | values
    theta[chain.index(motor)] = [part[slot.name] for slot in motor.slots()]
    return clip_to_bounds(chain, theta)


def _read(u: np.ndarray, y: np.ndarray) -> _Record:
    """The record's range, its speed at large inputs and the sign between both."""
    low, high = np.quantile(y, [_EDGE, 1.0 - _EDGE])
    reach = max(1, len(y) // 500)
    speed = (y[2 * reach :] - y[: -2 * reach]) / (2 * reach) if len(y) > 4 * reach else np.diff(y)
    drive = u[reach : len(u) - reach] if len(y) > 4 * reach else u[:-1]
    sign = 1.0 if float(np.sum(speed * (drive - np.mean(drive)))) >= 0.0 else -1.0
    strong = np.abs(drive) >= 0.5 * np.abs(drive).max()
    moving = strong & (sign * speed * drive > 0.0)
    moving &= np.abs(speed) > 0.2 * np.quantile(np.abs(speed), 0.95)
    if not moving.any():
        moving = strong
    return _Record(
        u, y, low, high, float(np.median(np.abs(speed[moving]))), float(np.median(np.abs(drive[moving]))), sign
    )


def _draw(chain: Chain, properties: _Record, rng: np.random.Generator, k: int) -> np.ndarray:
    """One candidate; the first is the simplest."""
    theta = np.zeros(len(chain.names))
    ends = _ends(chain, properties, rng)
    mapped = any(isinstance(b, Travel) for b in chain.blocks)
    values = _physics(properties, ends, mapped, None if k == 0 else rng)
    span = max(abs(ends[1] - ends[0]), 1e-12)
    for b in chain.blocks:
        part = _values(b, values, ends, span, properties)
        theta[chain.index(b)] = b.vary(part, rng) if k and isinstance(b, Travel) else part
        if isinstance(b, Compliance) and k:
            theta[chain.index(b).start : chain.index(b).start + 2] = np.exp(rng.uniform(*np.log(_LINKS)))
    return clip_to_bounds(chain, theta)


def _ends(chain: Chain, properties: _Record, rng: np.random.Generator) -> tuple[float, float]:
    """Outputs at the motor's lower and upper end."""
    if chain.block("sensor") is None:
        return (properties.low, properties.high) if properties.sign > 0 else (properties.high, properties.low)
    # What a sensor shows says little of where the ends are: try either side of zero.
    reach = max(abs(properties.low), abs(properties.high))
    share = rng.uniform(0.0, 1.0) if rng.random() < 0.8 else 1.0
    return (-reach * share, reach) if rng.random() < 0.5 else (-reach, reach * share)


def _physics(
    properties: _Record, ends: tuple[float, float], mapped: bool, rng: np.random.Generator | None
) -> dict[str, float]:
    """The motor's parameters by name, drawn with `rng`; its position is in strokes if a travel map follows."""
    way = ends[1] - ends[0] or 1.0
    first = float(properties.y[: max(1, min(3, len(properties.y)))].mean())
    friction, tilt, load, haste, lag, stick, delay, creep = 0.15, 0.0, 0.0, 1.0, 0.5, 0.2, 0.2, 0.03
    if rng is not None:
        friction = np.exp(rng.uniform(np.log(0.01), np.log(0.7)))
        tilt, load = rng.uniform(-0.4, 0.4), rng.normal() * 0.1
        haste = np.exp(0.15 * rng.normal())
        lag = np.exp(rng.uniform(np.log(0.1), np.log(max(3.0, len(properties.y) / 400))))
        stick, delay = rng.uniform(0.0, 0.6), rng.uniform(0.0, 1.0)
        creep = np.exp(rng.uniform(*np.log([0.003, 0.3])))
    dry = friction * properties.volts
    rest = max(properties.volts - dry, 0.05 * properties.volts)  # of the volts, for speed
    gain = properties.speed / (rest or 1.0) / (abs(way) if mapped else 1.0) * haste
    return {
        "gain": gain if mapped or properties.sign > 0 else 1e-6,
        "lag": lag,
        "rise": dry * (1.0 + tilt),
        "fall": dry * (1.0 - tilt),
        "stick": dry * stick,
        "stick_down": dry * stick,
        "stick_speed": gain * properties.volts * creep,
        "load0": load * properties.volts,
        "loss": 0.1,
        **({} if mapped or rng is None else _drawn_load(properties, way, rng)),
        "delay": delay,
        "lower": 0.0 if mapped else properties.low,
        "upper": 1.0 if mapped else properties.high,
        "x0": float(np.clip((first - ends[0]) / way, 0.0, 1.0)) if mapped else first,
    }


def _drawn_load(properties: _Record, way: float, rng: np.random.Generator) -> dict[str, float]:
    """A load over the position; that of a mapped motor begins flat."""
    waves = {name: 0.3 * properties.volts * rng.normal() for name in ("sine1", "cosine1")}
    return waves | {"load1": properties.volts * rng.uniform(0.0, 1.0) ** 2 / max(abs(way), 1e-12)}


def _values(
    b: Block, values: dict[str, float], ends: tuple[float, float], span: float, properties: _Record
) -> np.ndarray:
    """The parameters of one block of a candidate."""
    if isinstance(b, Motor):
        return np.array([values.get(slot.name, 0.0) for slot in b.slots()])
    if isinstance(b, Travel):
        part = b.start(np.zeros(1))
        part[:2] = ends
        return part
    if isinstance(b, Play):
        part = b.start(np.zeros(1))
        part[0] = 0.005 * span
        return part
    return b.start(properties.u if b.role == "driver" else properties.y)


def balances(motor: Motor, u: np.ndarray, y: np.ndarray, ends: tuple[float, float]) -> list[dict[str, float]]:
    """The motor's parameters by name, once for each window and delay tried; u (N,) [V], and y (N,), its position.

    Over a window the mean of u is lag / gain times the mean acceleration + 1 / gain times the mean speed + rise or fall
    by the direction + the mean of the load. Windows beside an end of the record's range are left out where the motor
    has a stop there.
    """
    motors = []
    for delay in _DELAYS if motor.delayed else (0,):
        for W in sorted({max(4, len(y) // count) for count in _WINDOWS}):
            values = _balance(motor, u[: len(u) - delay], y[delay:], W, ends)
            if values is not None:
                motors.append(values | {"delay": float(delay), "x0": float(y[0])})
    return motors


def _balance(motor: Motor, u: np.ndarray, y: np.ndarray, W: int, ends: tuple[float, float]) -> dict[str, float] | None:
    """The motor's parameters by name from windows of W samples; None where too few are free of the ends."""
    half = max(2, W // 6)
    k = np.arange(-half, half + 1)
    if len(y) < 8 * W or len(y) < 4 * half:
        return None
    smooth = np.convolve(y, np.ones(len(k)) / len(k), "same")
    v = np.convolve(y, k[::-1] / np.sum(k**2), "same")
    rising, falling = (v > 0.0).astype(float), (v < 0.0).astype(float)
    loads = _loads(motor, smooth)
    edges = np.arange(half, len(y) - half, W)

    def means(x: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(x)])
        return np.diff(total[edges]) / W

    A = np.column_stack([np.diff(v[edges]) / W, *map(means, (v, rising, -falling, *loads.values()))])
    b, inner = means(u), np.ones(len(edges) - 1, dtype=bool)
    margin = _NEAR * (ends[1] - ends[0])
    if "lower" in motor.ends:
        inner &= means((y < ends[0] + margin).astype(float)) == 0.0
    if "upper" in motor.ends:
        inner &= means((y > ends[1] - margin).astype(float)) == 0.0
    if inner.sum() < 2 * A.shape[1]:
        return None
    A, b = A[inner], b[inner]
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    least = np.full(A.shape[1], -np.inf)
    least[:4] = 0.0
    inertia, drag, rise, fall, *rest = lsq_linear(A / scale, b, (least, np.inf)).x / scale
    if drag <= 0.0:
        return None
    return {
        "gain": 1.0 / drag,
        "lag": inertia / drag,
        "rise": rise,
        "fall": fall,
        **dict(zip(loads, rest, strict=True)),
    }


def _loads(motor: Motor, y: np.ndarray) -> dict[str, np.ndarray]:
    """The load over the position, by its coefficients; a constant load is a difference between the frictions."""
    loads = {f"load{i}": (y - motor.at) ** i for i in range(1, motor.load)}
    waves = {"s": np.sin, "c": np.cos}
    return loads | {name: waves[name[0]](int(name[-1]) * motor.turn * y) for name in motor.waves}

"""Parts of a motor-driven joint: chains with more or fewer parts, and initial values of added parts."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Motor, ServoMotor
from sysid.blocks.linkage import SHAPE
from sysid.data.record import IOData
from sysid.model.chain import Chain

Part = dict[str, float]
# How far a value is shaken (standard deviation): in parts of itself, or, of those that may be zero, in their own unit.
_SHAKEN = {
    **{"gain": 0.01, "rise": 0.05, "fall": 0.05, "lag": 0.5, "stick": 0.3, "stick_speed": 0.5, "loss": 0.3, "jam": 0.5},
    **{"stick_down": 0.3, "width": 0.2, "drag": 0.5},
}
_DELAY = 0.3  # samples
_LOAD = 0.1  # of the mean dry friction
_END = 0.003  # of the way between the ends


def is_joint(chain: Chain) -> bool:
    """Whether the chain has a motor."""
    return any(isinstance(b, Motor) for b in chain.blocks)


def motor_of(chain: Chain) -> Motor:
    """The chain's motor."""
    return next(b for b in chain.blocks if isinstance(b, Motor))


def plainer(chain: Chain) -> Chain | None:
    """The chain with dry friction only and without a coasting play; None if it already has this form."""
    motor = motor_of(chain)
    plain = replace(motor, stribeck=False, sided=False, loss=False, jams=False, substeps=min(motor.substeps, 2))
    blocks = tuple(plain if b is motor else b for b in without_play(chain).blocks)
    return None if blocks == chain.blocks else sub(chain, blocks)


def without_play(chain: Chain) -> Chain:
    """The chain without a coasting play."""
    blocks = tuple(b for b in chain.blocks if not isinstance(b, CoastingPlay))
    return chain if len(blocks) == len(chain.blocks) else sub(chain, blocks)


def sub(chain: Chain, blocks: tuple[Block, ...], hold: Mapping[str, float] | None = None) -> Chain:
    """A chain of other blocks, with those entries of `fixed_values`, `hold` and `bounds` that apply to it.

    A constant load is fixed at zero if it cannot be distinguished from a difference between upward and downward
    friction.
    """
    names = Chain(blocks).names
    fixed_values = {name: value for name, value in {**chain.fixed, **(hold or {})}.items() if name in names}
    for b in blocks:
        if isinstance(b, Motor) and b.load and not b.loss:
            fixed_values.setdefault(f"{b.role}.load0", 0.0)
    bounds = {name: limits for name, limits in chain.bounds.items() if name in names}
    return Chain(blocks, chain.structure, fixed_values, bounds)


def lift_theta(chain: Chain, theta: np.ndarray, richer: Chain, part: Part) -> np.ndarray:
    """theta of a chain with more parts: the common parameters, the fixed ones of the larger chain, and `part`."""
    values = dict(zip(chain.names, theta, strict=True))
    lever = {f"motor.{name}": values.get(f"map.{name}", 0.0) for name in SHAPE}  # that of the linkage
    values = lever | values | part | dict(richer.fixed)
    return np.clip([values.get(name, 0.0) for name in richer.names], *richer.limits)


def shake_theta(chain: Chain, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """theta (P,) with small random changes of the motor parameters and the end positions."""
    values = dict(zip(chain.names, theta, strict=True))
    role, _, rise, fall = _read(chain, theta)
    steps = {
        f"{role}.delay": _DELAY,
        f"{role}.load1": _LOAD * (rise + fall) / 2,
        f"{role}.load2": _LOAD * (rise + fall) / 2,
    }
    if "map.low" in values:
        steps |= dict.fromkeys(("map.low", "map.high"), _END * abs(values["map.high"] - values["map.low"]))
    out = []
    for name, value, z in zip(chain.names, theta, rng.normal(size=len(theta)), strict=True):
        step = steps.get(name)
        out.append(value + step * z if step is not None else value * np.exp(_SHAKEN.get(name.split(".")[-1], 0.0) * z))
    return np.where(chain.free, out, theta)


def free_run_cost(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> float:
    """Sum of squared errors of the free run under u (N,) or (N, nu); infinite where theta is no model or runs away."""
    if not chain.admissible(theta):
        return np.inf
    e = y - chain.simulate(theta, u)
    cost = float(e @ e)
    return cost if np.isfinite(cost) else np.inf


def differ_in_motor(chain: Chain, a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two candidates differ by a fifth or more in a parameter of the motor."""
    motor = motor_of(chain)
    x, y = chain.part(a, motor), chain.part(b, motor)
    return bool(np.any(np.abs(x - y) > 0.2 * np.maximum(np.abs(x), np.abs(y)) + 1e-12))


def friction_starts(names: tuple[str, ...], chain: Chain, theta: np.ndarray, data: IOData) -> list[Part]:
    """Initial values of the frictions `names` in every combination, added to the optimum theta of `chain`."""
    parts = product(*(FRICTIONS[name](chain, theta, data) for name in names))
    return [{name: value for part in combination for name, value in part.items()} for combination in parts]


def _read(chain: Chain, theta: np.ndarray) -> tuple[str, float, float, float]:
    """The motor's role, gain, rise and fall."""
    motor = motor_of(chain)
    gain, rise, fall = (motor.value(chain.part(theta, motor), name) for name in ("gain", "rise", "fall"))
    return motor.role, gain, rise, fall


def _stribeck(chain: Chain, theta: np.ndarray, data: IOData) -> list[Part]:
    role, gain, rise, fall = _read(chain, theta)
    mean = 0.5 * (rise + fall)
    return [
        {f"{role}.stick": 0.2 * mean, f"{role}.stick_speed": max(creep * gain * mean, 1e-8)} for creep in (0.1, 0.5)
    ]


def _two_sided(chain: Chain, theta: np.ndarray, data: IOData) -> list[Part]:
    """The friction at rest of both directions, and more of it in one of them."""
    motor, (role, _, rise, fall) = motor_of(chain), _read(chain, theta)
    stick = motor.value(chain.part(theta, motor), "stick") or 0.1 * (rise + fall)
    names = (f"{role}.stick", f"{role}.stick_down")
    return [
        dict(zip(names, (share_up * stick, share_down * stick), strict=True))
        for share_up, share_down in ((1, 1), (1.5, 0.7), (0.7, 1.5))
    ]


def _loss(chain: Chain, theta: np.ndarray, data: IOData) -> list[Part]:
    """Direction-dependent friction replaced by a load and its screw loss, equal at mid stroke."""
    role, _, rise, fall = _read(chain, theta)
    parts = []
    for loss, share in ((0.1, 0.0), (0.7, 0.0), (0.3, 1.0), (1.0, 1.0)):
        load = share * (rise - fall) / 2
        loss_of_load = loss * abs(load)
        part = {"loss": loss, "load0": load, "rise": rise - load - loss_of_load, "fall": fall + load - loss_of_load}
        parts.append({f"{role}.{name}": value for name, value in part.items()})
    return parts


def _jam(chain: Chain, theta: np.ndarray, data: IOData) -> list[Part]:
    """A motor that hits a stop at full speed jams for 1.5, 4 or 10 samples."""
    role, gain, rise, fall = _read(chain, theta)
    dry = 0.5 * (rise + fall)
    motor = motor_of(chain)
    highest = float(np.abs(data.u).max())
    if isinstance(motor, ServoMotor):  # whose input is a goal
        highest = motor.value(chain.part(theta, motor), "limit")
    fastest = max(gain * max(highest - dry, 0.1 * dry), 1e-12)
    return [{f"{role}.jam": samples / fastest} for samples in (1.5, 4.0, 10.0)]


def _sag(chain: Chain, theta: np.ndarray, data: IOData) -> list[Part]:
    """A source with a tenth and with half of the motor's resistance."""
    return [{f"{motor_of(chain).role}.sag": sag} for sag in (0.1, 0.5)]


# What a motor's friction may have besides, by the option's name, and first values for it beside a plainer optimum.
FRICTIONS: dict[str, Callable[[Chain, np.ndarray, IOData], list[Part]]] = {
    "stribeck": _stribeck,
    "sided": _two_sided,
    "loss": _loss,
    "jams": _jam,
    "sags": _sag,
}

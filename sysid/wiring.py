"""A chain with its numbers as a wiring of one-channel units: what exporters and the closed form walk through."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sysid.block import Block, StaticBlock
from sysid.blocks import CubicSpline, Motor, PiecewiseLinear, TravelMap
from sysid.chain import Chain
from sysid.errors import InputError
from sysid.model.compiler.recursion import Recursion
from sysid.model.writing import Code, Writer, number

T = TypeVar("T")
SHORTEST = 1e-12  # samples; what is left of a sample below it is over, as in the kernels
EVENTS = 4  # turns of a motor within one stretch of constant input, as in the kernels


@dataclass(frozen=True)
class Unit:
    """A block of one input and one output with its parameters theta (p,); `name` is an identifier, unique."""

    name: str
    block: Block
    theta: np.ndarray


# A layer is one block of the chain: for each of its outputs, the units that are summed and the input each one reads.
Layer = tuple[tuple[tuple[Unit, int], ...], ...]


def layers(model: Chain, theta: np.ndarray) -> tuple[Layer, ...]:
    """The chain's blocks in order, those of several channels taken apart, with their part of theta (P,).

    Raises InputError where theta is not finite: no text stands for such a model.
    """
    if not np.all(np.isfinite(theta)):
        raise InputError("a parameter of this model is not finite; fit it again before writing it out")
    return tuple(_layer(k, b, model.part(np.asarray(theta, dtype=float), b)) for k, b in enumerate(model.blocks, 1))


def _layer(k: int, block: Block, theta: np.ndarray) -> Layer:
    n_in, n_out = block.channels
    parts = block.parts()
    name = re.sub(r"\W", "_", f"block{k}_{block.role}", flags=re.ASCII)
    units = [Unit(name if len(parts) == 1 else f"{name}_{i}", b, theta[s]) for i, (s, b) in enumerate(parts, 1)]
    if len(units) == n_in == n_out:  # one map, or maps side by side
        return tuple(((unit, i),) for i, unit in enumerate(units))
    if len(units) == n_in * n_out:  # a matrix, row after row
        return tuple(tuple((units[j * n_in + i], i) for i in range(n_in)) for j in range(n_out))
    raise InputError(f"block {block.role!r} has {len(units)} parts for {n_in} inputs and {n_out} outputs")


def entry(table: Mapping[type[Block], Callable[..., T]], unit: Unit, what: str) -> Callable[..., T]:
    """The line of `table` for a unit's block; raises InputError for a block without one."""
    if isinstance(unit.block, Recursion):
        way = {"C": "c", "Python": "python", "text": "equations"}[what]
        return lambda block, *rest: getattr(block, way)(*rest)
    if type(unit.block) not in table:
        static = isinstance(unit.block, StaticBlock)
        way = "fit a piecewise linear map or a spline in its place" if static else "run the fit itself, in Python"
        raise InputError(
            f"{unit.name} is a {type(unit.block).__name__} block, which has no formula to write as {what}; {way}"
        )
    return table[type(unit.block)]


def break_points(block: PiecewiseLinear, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the break points (knots,), free or fixed."""
    n = block.knots
    return (theta[:n], theta[n:]) if block.free_knots else (np.array(block.at, dtype=float), theta)


def cubics(block: CubicSpline, theta: np.ndarray) -> tuple[float, float, np.ndarray]:
    """lo, hi and coefficients (m, 4) on the m equal intervals between, powers 0..3 of the place within an interval."""
    lo, hi = block.span if block.span is not None else theta[:2]
    values = theta if block.span is not None else theta[2:]
    return float(lo), float(hi), block.pieces @ values


def strokes(block: TravelMap, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots of a travel map (knots,) and the share of the way that each one stands for."""
    return np.linspace(0.0, 1.0, block.knots), np.concatenate([[0.0], theta[2:], [1.0]])


def arcs(block: TravelMap, theta: np.ndarray) -> np.ndarray:
    """The curve of a smooth travel map's shares as `cubics` has it, from 0 to 1: coefficients (knots - 1, 4)."""
    return CubicSpline(block.knots, span=(0.0, 1.0)).pieces @ strokes(block, theta)[1]


def by_name(block: Block, theta: np.ndarray) -> dict[str, float]:
    """theta (p,) by the names of the block's parameters."""
    return {slot.name: float(value) for slot, value in zip(block.slots(), theta, strict=True)}


def arrivals(block: Motor, theta: np.ndarray) -> list[tuple[int, float]]:
    """The stretches of one sample over which a motor's input stands: how many samples old it is, how long it stands."""
    delay = by_name(block, theta).get("delay", 0.0)
    whole = math.floor(delay)
    stretches = [(whole + 1, delay - whole), (whole, 1.0 - (delay - whole))]
    return [(age, length) for age, length in stretches if length > SHORTEST]


def identifier(name: str) -> str:
    """`name` where it is an identifier in C and Python alike; raises InputError elsewhere."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, flags=re.ASCII):
        raise InputError(f"{name!r} is no identifier; give letters, digits and _, a letter first")
    return name


def offsets(value: float | np.ndarray, n: int, name: str) -> np.ndarray:
    """One number for all n channels, or n of them, as (n,)."""
    array = np.atleast_1d(np.asarray(value, dtype=float))
    if array.shape not in ((1,), (n,)) or not np.all(np.isfinite(array)):
        raise InputError(f"{name} is {value!r}; give one finite number or {n}, one for each channel")
    return np.broadcast_to(array, (n,))

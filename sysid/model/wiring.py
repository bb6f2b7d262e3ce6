"""A chain with its numbers as a wiring of one-channel units, for the exporters and the closed form."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.blocks import CubicSpline, Motor, PiecewiseLinear, TravelMap
from sysid.model.chain import Chain

T = TypeVar("T")
SHORTEST = 1e-12  # samples; a shorter rest of a sample is ignored, as in the kernels
EVENTS = 4  # reversals of a motor within one interval of constant input, as in the kernels


@dataclass(frozen=True)
class Code:
    """Body of an exported function of `x`: may read tables by name and keep `state` numbers in `s`.

    `start` holds the names and initial values of the first of these numbers; all others start at zero.
    """

    body: str
    state: int = 0
    tables: dict[str, np.ndarray] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Unit:
    """A block of one input and one output with its parameters theta (p,); `name` is an identifier, unique."""

    name: str
    block: Block
    theta: np.ndarray


@dataclass(frozen=True)
class Writer:
    """Names of a unit's input x and output y, and how its numbers are written (None: exactly)."""

    x: str
    y: str
    digits: int | None

    def num(self, value: float) -> str:
        """A number, in brackets if it is negative."""
        plain = number(value) if self.digits is None else f"{float(value):.{self.digits}g}"
        return f"({plain})" if plain.startswith("-") else plain

    def sum(self, terms: list[tuple[float, str]]) -> str:
        """c1*a + c2*b - ... without the terms of weight zero; an empty name means the number alone."""
        parts: list[str] = []
        for c, name in terms:
            if c == 0.0:
                continue
            sign = ("-" if c < 0 else "") if not parts else (" - " if c < 0 else " + ")
            size = self.num(abs(c))
            factor = size if not name else (name if size in ("1", "1.0") else f"{size}*{name}")
            parts.append(sign + factor)
        return "".join(parts) or "0"

    def minus(self, value: float) -> str:
        """(x - value) as a factor."""
        return self.x if value == 0.0 else f"({self.sum([(1.0, self.x), (-value, '')])})"


# A layer is one block of the chain: for each of its outputs, the units that are summed and the input each one reads.
Layer = tuple[tuple[tuple[Unit, int], ...], ...]


def layers(model: Chain, theta: np.ndarray) -> tuple[Layer, ...]:
    """The chain's blocks in order, split by channel, with their part of theta (P,).

    Raises InputError if theta is not finite: such a model cannot be written as text.
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
    """The entry of `table` for a unit's block; raises InputError for a block without one."""
    if type(unit.block) not in table:
        static = isinstance(unit.block, StaticBlock)
        way = "fit a piecewise linear map or a spline instead" if static else "use the fit itself in Python"
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
    """The intervals of one sample with constant motor input: the age of the input in samples and the length."""
    delay = by_name(block, theta).get("delay", 0.0)
    whole = math.floor(delay)
    stretches = [(whole + 1, delay - whole), (whole, 1.0 - (delay - whole))]
    return [(age, length) for age, length in stretches if length > SHORTEST]


def identifier(name: str) -> str:
    """`name` if it is an identifier in both C and Python; otherwise raises InputError."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, flags=re.ASCII):
        raise InputError(f"{name!r} is not an identifier; give letters, digits and _, a letter first")
    return name


def number(value: float) -> str:
    """The shortest text that reads back as exactly this float, in C and in Python."""
    return repr(float(value))


def offsets(value: float | np.ndarray, n: int, name: str) -> np.ndarray:
    """One number for all n channels, or n of them, as (n,)."""
    array = np.atleast_1d(np.asarray(value, dtype=float))
    if array.shape not in ((1,), (n,)) or not np.all(np.isfinite(array)):
        raise InputError(f"{name} is {value!r}; give one finite number or {n}, one for each channel")
    return np.broadcast_to(array, (n,))

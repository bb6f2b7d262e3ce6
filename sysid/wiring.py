"""A chain with its numbers as a wiring of one-channel units: what exporters and the closed form walk through."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from sysid.block import Block, StaticBlock
from sysid.blocks import CubicSpline, PiecewiseLinear
from sysid.chain import Chain
from sysid.errors import InputError

T = TypeVar("T")


@dataclass(frozen=True)
class Code:
    """Body of an exported function of `x`: may read tables by name and keep `state` numbers in `s`, zero at rest."""

    body: str
    state: int = 0
    tables: dict[str, np.ndarray] = field(default_factory=dict)


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
    if type(unit.block) not in table:
        if not isinstance(unit.block, StaticBlock):
            raise InputError(
                f"{unit.name} is a {type(unit.block).__name__} block, which cannot be written as {what} yet; save "
                "the fit as JSON and run it in Python"
            )
        raise InputError(
            f"{unit.name} is a {type(unit.block).__name__} block, which has no formula to write as {what}; "
            "fit a piecewise linear map or a spline in its place"
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


def identifier(name: str) -> str:
    """`name` where it is an identifier in C and Python alike; raises InputError elsewhere."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, flags=re.ASCII):
        raise InputError(f"{name!r} is no identifier; give letters, digits and _, a letter first")
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

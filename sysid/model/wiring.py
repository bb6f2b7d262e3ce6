"""A chain with its numbers as a wiring of one-channel units, for the exporters and the closed form."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.block.compiler.recursion import Map, Recursion
from sysid.model.chain import Chain


@dataclass(frozen=True)
class Unit:
    """A block with its parameters theta (p,), of one input and one output but for `whole`; `name` is an identifier,
    unique.
    """

    name: str
    block: Block
    theta: np.ndarray


# A layer is one block of the chain: for each of its outputs, the units that are summed and the input each one reads;
# a block of several channels that has no parts is one unit, see `whole`.
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
    if len(units) == 1 and (n_in, n_out) != (1, 1):
        return tuple(((units[0], 0),) for _ in range(n_out))
    if len(units) == n_in == n_out:  # one map, or maps side by side
        return tuple(((unit, i),) for i, unit in enumerate(units))
    if len(units) == n_in * n_out:  # a matrix, row after row
        return tuple(tuple((units[j * n_in + i], i) for i in range(n_in)) for j in range(n_out))
    raise InputError(f"block {block.role!r} has {len(units)} parts for {n_in} inputs and {n_out} outputs")


def whole(layer: Layer) -> Unit | None:
    """The unit that takes all inputs of a layer and gives all its outputs; None for a layer of one-channel units."""
    unit = layer[0][0][0]
    return unit if unit.block.channels != (1, 1) else None


def written(unit: Unit, what: str) -> Callable[..., Any]:
    """How a unit's block writes itself: its method `c`, `python` or `equations`.

    Raises InputError for a block without one, or whose run is another than that of the block that it took this from.
    """
    kind = type(unit.block)
    order = kind.__mro__
    writer_class = next(c for c in order if {what, "functions"} & set(vars(c)))
    run = next(c for c in order if {"propagate", "evaluate"} & set(vars(c)))
    if writer_class is Block or (run not in (Recursion, Map) and order.index(run) < order.index(writer_class)):
        static = isinstance(unit.block, StaticBlock)
        way = "fit a piecewise linear map or a spline in its place" if static else "run the fit itself, in Python"
        form = {"c": "C", "python": "Python", "equations": "text"}[what]
        raise InputError(f"{unit.name} is a {kind.__name__} block, which has no formula to write as {form}; {way}")
    method: Callable[..., Any] = getattr(unit.block, what)
    return method


def identifier(name: str) -> str:
    """`name` if it is an identifier in both C and Python; otherwise raises InputError."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, flags=re.ASCII):
        raise InputError(f"{name!r} is not an identifier; give letters, digits and _, a letter first")
    return name


def offsets(value: float | np.ndarray, n: int, name: str) -> np.ndarray:
    """One number for all n channels, or n of them, as (n,)."""
    array = np.atleast_1d(np.asarray(value, dtype=float))
    if array.shape not in ((1,), (n,)) or not np.all(np.isfinite(array)):
        raise InputError(f"{name} is {value!r}; give one finite number or {n}, one for each channel")
    return np.broadcast_to(array, (n,))

"""Offset: y = x + y0, the zero of an output."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Block, Law, Slot
from sysid.block.compiler.recursion import Map
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer


def value(x, p):
    return x + p.y0


@checked
@dataclass(frozen=True)
class Offset(Map):
    """y = x + y0; behind maps that cannot hold the offset of an output themselves, or behind a filter alone.

    With it no mean has to be taken off a record before a fit: a mean is no operating point of a record that begins at
    rest, and a saturation or an integrator counts from a zero of its own. `found` where a fit has put it there, behind
    a named shape. `each`: every experiment has a zero of its own, as on another day; that of a run is found with its
    initial state.
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    found: bool = field(default=False, kw_only=True)
    each: bool = field(default=False, kw_only=True)

    def asked(self) -> Block | None:
        return None if self.found else self

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("y0", initial=self.each, holds=self.each),)

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        return [f"{w.y} = {w.sum([(1.0, w.x), (float(theta[0]), '')])}"]

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(1)

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        return Law(self, np.diag(b)) if a[0] == b[0] else None

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        return [
            Symmetry(theta.copy(), in_scale=1.0, out_scale=1.0),
            Symmetry(-np.ones(1), in_shift=1.0),
            Symmetry(np.ones(1), out_shift=1.0),
        ]


def is_offset(block: Block) -> bool:
    """Whether a block is the offset of one output or of each; figures draw it with the map before it."""
    return all(isinstance(part, Offset) for _, part in block.parts())

"""Maps of a few numbers that a fit may put in place of one of many break points."""

import re
from dataclasses import dataclass, field

import numpy as np

from sysid.block.block import Block
from sysid.block.compiler.recursion import Map
from sysid.blocks.piecewise_linear import PiecewiseLinear


@dataclass(frozen=True)
class Shape(Map):
    """A map of a few numbers. `found` where a fit was asked for a piecewise linear one and the record named this."""

    found: bool = field(default=False, kw_only=True)

    @property
    def words(self) -> str:
        """What people call it."""
        return "a " + re.sub(r"(?<!^)(?=[A-Z])", " ", type(self).__name__).lower()

    def asked(self) -> Block:
        return PiecewiseLinear(role=self.role) if self.found else self

    def finer(self, theta: np.ndarray, x: np.ndarray, knots: int) -> tuple[Block, np.ndarray] | None:
        lo, hi = float(x.min()), float(x.max())
        if not self.found or not lo < hi:
            return None
        places = np.linspace(lo, hi, knots)
        return PiecewiseLinear(free_knots=False, at=tuple(places.tolist()), role=self.role), self.output(theta, places)

"""Play (backlash): the output follows after the input has crossed the width."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion


def begin(s, x, p):
    s.place = x + p.rest * p.width


def step(s, x, p):
    half = 0.5 * p.width
    s.place = min(max(s.place, x - half), x + half)
    return s.place


@checked
@dataclass(frozen=True)
class Play(Recursion):
    """y is constant while x - width / 2 <= y <= x + width / 2 and moves with x at either side.

    `rest` is the initial position of the output within the backlash, from -1/2 to 1/2. The derivative at a reversal is
    that of the branch taken. The link has no inertia; see `CoastingPlay` for a link with inertia.
    """

    functions: ClassVar = {"step": step, "begin": begin}

    def slots(self) -> tuple[Slot, ...]:
        return Slot("width", lower=0.0), Slot("rest", lower=-0.5, upper=0.5, initial=True, holds=True)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(self.n_parameters)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] >= 0.0)

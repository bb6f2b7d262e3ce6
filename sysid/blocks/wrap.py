"""Wrap: a sensor that shows an angle within one turn."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Map
from sysid.block.step import floor


def value(x, p, block):
    return x - block.turn * floor((x - block.low) / block.turn)


@checked
@dataclass(frozen=True)
class Wrap(Map):
    """y = x less the whole turns, from `low` to `low` + `turn`, as an absolute encoder shows an angle.

    turn is 2 pi, 360 or the encoder's counts. A fit through a wrap has errors of a whole turn where model and record
    wrap at different samples: undo the wraps of a record first, with `sysid.data.wraps.unwrapped`, and use this block
    where a model must show what the sensor shows.
    """

    functions: ClassVar = {"value": value}

    turn: float = 2.0 * np.pi
    low: float = -np.pi

    def __post_init__(self) -> None:
        if not 0.0 < self.turn < np.inf or not np.isfinite(self.low):
            raise InputError(
                f"a turn is {self.turn} from {self.low}; give a turn above 0, 2 pi or 360, and a finite low"
            )

    def slots(self) -> tuple[Slot, ...]:
        return ()

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.empty(0)

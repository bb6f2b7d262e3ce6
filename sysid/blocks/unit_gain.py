"""Unit gain: y = x."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Law, Slot
from sysid.block.compiler.recursion import Map
from sysid.block.symmetry import Symmetry


def value(x, p):
    return x


@checked
@dataclass(frozen=True)
class UnitGain(Map):
    """y = x; removes the map from a Hammerstein-Wiener chain."""

    functions: ClassVar = {"value": value}

    def slots(self) -> tuple[Slot, ...]:
        return ()

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        return x, np.ones_like(x)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.empty(0)

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        return Law(self, np.eye(0)) if a[0] == b[0] else None

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        none = np.empty(0)
        return [Symmetry(none, in_scale=1.0, out_scale=1.0), Symmetry(none, in_shift=1.0, out_shift=1.0)]

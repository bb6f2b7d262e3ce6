"""Integrator between two stops."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.symmetry import Symmetry


def begin(s, x, p):
    s.position = min(max(p.x0, p.lower), p.upper)


def step(s, x, p):
    y = s.position
    s.position = min(max(y + p.gain * x, p.lower), p.upper)
    return y


@checked
@dataclass(frozen=True)
class LimitedIntegrator(Recursion):
    """x_{t+1} = x_t + gain w_t, held between `lower` and `upper`; x_0 is estimated.

    For a plant without inertia; with inertia a stop also sets the speed to zero, see `Motor`. The
    derivative at a stop is that of the stop.
    """

    functions: ClassVar = {"step": step, "begin": begin}

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("gain"), Slot("lower"), Slot("upper"), Slot("x0", initial=True, holds=True))

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.array([1.0 / max(float(np.abs(x).sum()), 1e-9), -1.0, 1.0, 0.0])

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[1] < theta[2])

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        scaling = np.array([theta[0], 0.0, 0.0, 0.0])
        return [
            Symmetry(-scaling, in_scale=1.0),
            Symmetry(theta.copy(), out_scale=1.0),
            Symmetry(np.array([0.0, 1.0, 1.0, 1.0]), out_shift=1.0),
        ]

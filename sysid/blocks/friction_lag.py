"""Speed of a drive with smooth dry friction: voltage in, speed out."""

from dataclasses import dataclass
from math import tanh
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer


def begin(s, x, p):
    s.speed = p.v0


def rate(v, x, p):
    return p.gain * x - p.drag * v - p.friction * tanh(v / p.onset)


def step(s, x, p, block):
    y, h = s.speed, 1.0 / block.substeps
    for _ in range(block.substeps):
        middle = s.speed + 0.5 * h * rate(s.speed, x, p)
        s.speed += h * rate(middle, x, p)
    return y


@checked
@dataclass(frozen=True)
class FrictionLag(Recursion):
    """v' = gain u - drag v - friction tanh(v / onset), time in samples.

    A first-order lag with a short time constant and low gain at low speed, and a long time constant and high gain
    beyond `onset`: the speed of a motor with dry friction that often reverses. It never sticks; use `Motor` for a
    motor that stands still under voltage. Each sample is integrated by the midpoint rule in `substeps` parts.
    """

    functions: ClassVar = {"step": step, "begin": begin}

    substeps: int = 8

    def __post_init__(self) -> None:
        if self.substeps < 1:
            raise InputError(f"substeps is {self.substeps}; give at least 1")

    def slots(self) -> tuple[Slot, ...]:
        return (
            Slot("gain"),
            Slot("drag", "1/sample", lower=0.0),
            Slot("friction", lower=0.0),
            Slot("onset", lower=1e-3),
            Slot("v0", initial=True),
        )

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The equation of motion in v', which the step solves by the midpoint rule."""
        gain, drag, friction, onset, _ = theta.tolist()
        rate = w.sum([(gain, w.x), (-drag, w.y), (-friction, f"tanh({w.y}/{w.num(onset)})")])
        return [
            f"{w.y}' = {rate}, time in samples",
            f"  {w.x} is held over each sample; midpoint rule in {self.substeps} equal parts of it",
        ]

    def start(self, x: np.ndarray) -> np.ndarray:
        """A lag of ten samples with unit gain and a little friction."""
        size = max(float(np.abs(x).max(initial=0.0)), 1e-9)
        return np.array([0.1, 0.07, 0.03 * size, 0.3 * size, 0.0])

    def admissible(self, theta: np.ndarray) -> bool:
        """False if friction accelerates the drive, or if a substep is too long for the lag at rest."""
        _, drag, friction, onset, _ = theta
        return bool(drag >= 0.0 and friction >= 0.0 and onset > 0.0 and drag + friction / onset < self.substeps)

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        gain, _, friction, onset, v0 = theta
        return [
            Symmetry(np.array([-gain, 0.0, 0.0, 0.0, 0.0]), in_scale=1.0),
            Symmetry(np.array([gain, 0.0, friction, onset, v0]), out_scale=1.0),
        ]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Gain, drag, friction and onset changed by up to about a factor of two, within the stability limit."""
        varied = theta * np.concatenate([np.exp(0.5 * rng.normal(size=4)), [1.0]])
        return varied if self.admissible(varied) else theta

"""Dead zone: zero between lower and upper, unit slope outside."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Law, Slot
from sysid.block.symmetry import Symmetry, diagonal
from sysid.blocks._shape import Shape


def value(x, p):
    return x - min(max(x, p.lower), p.upper)


NARROW = 1e-6  # half the width of a dead zone that is as good as none, of the largest value


def middle(lo: float, hi: float) -> float:
    """Where a dead zone of an input from `lo` to `hi` is first looked for: zero, if that is well inside."""
    margin = 0.1 * (hi - lo)
    return 0.0 if lo + margin < 0.0 < hi - margin else 0.5 * (lo + hi)


@checked
@dataclass(frozen=True)
class DeadZone(Shape):
    """y = x - lower below `lower`, x - upper above `upper`, 0 between; two parameters.

    The derivative at a break point is one-sided (zero).
    """

    functions: ClassVar = {"value": value}

    def slots(self) -> tuple[Slot, ...]:
        return Slot("lower"), Slot("upper")

    def start(self, x: np.ndarray) -> np.ndarray:
        """Narrow, about zero or, where zero is not well inside the signal's range, about the middle of that.

        A few samples far from all others say nothing about that range.
        """
        lo, hi = (float(q) for q in np.percentile(x, (2.0, 98.0)))
        return middle(lo, hi) + 0.05 * (hi - lo) * np.array([-1.0, 1.0])

    def straight(self, x: np.ndarray) -> np.ndarray:
        return NARROW * float(np.abs(x).max()) * np.array([-1.0, 1.0])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        return Law(self, diagonal(a[0], 2, bool(a[0] < 0.0))) if a[0] == b[0] else None

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        return [Symmetry(theta.copy(), in_scale=1.0, out_scale=1.0), Symmetry(np.ones(2), in_shift=1.0)]

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] < theta[1])

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Another width, and every second time another place: the start is about a tenth of the range wide."""
        widths, away = rng.uniform(0.2, 4.0, 2), rng.uniform(-10.0, 10.0) * rng.integers(2)
        return theta.mean() + 0.5 * (theta[1] - theta[0]) * (away + np.array([-1.0, 1.0]) * widths)

"""Dead zone and saturation in one map, with a separate slope on each side."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Law, Slot
from sysid.block.symmetry import Symmetry, block_diagonal, diagonal
from sysid.block.writing import Writer
from sysid.blocks._shape import Shape
from sysid.blocks.dead_zone import NARROW, middle


def value(x, p):
    if x < p.dead_lower:
        return p.gain_lower * (max(x, p.saturation_lower) - p.dead_lower)
    if x > p.dead_upper:
        return p.gain_upper * (min(x, p.saturation_upper) - p.dead_upper)
    return 0.0


@checked
@dataclass(frozen=True)
class DeadZoneSaturation(Shape):
    """Zero from `dead_lower` to `dead_upper`, slopes `gain_lower`, `gain_upper` outside, constant beyond saturation.

    y = gain_lower (max(x, saturation_lower) - dead_lower) below the dead zone, gain_upper (min(x, saturation_upper) -
    dead_upper) above it: an amplifier with dead zone, limited supply and direction-dependent gain. Six parameters; all
    four break points are values of x. The derivative at a break point is one-sided. If no sample passes a break point,
    its column is zero and the data do not determine it.
    """

    functions: ClassVar = {"value": value}

    def slots(self) -> tuple[Slot, ...]:
        break_points = ("saturation_lower", "dead_lower", "dead_upper", "saturation_upper")
        return tuple(Slot(name) for name in (*break_points, "gain_lower", "gain_upper"))

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        s_lo, d_lo, d_up, s_up, a_lo, a_up = theta
        curves = [
            w.sum([(a_lo * (s_lo - d_lo), "")]),
            w.sum([(a_lo, w.minus(d_lo))]),
            "0",
            w.sum([(a_up, w.minus(d_up))]),
            w.sum([(a_up * (s_up - d_up), "")]),
        ]
        return w.pieces(theta[:4], curves)

    def start(self, x: np.ndarray) -> np.ndarray:
        """Unit slopes and every break point slightly inside the range of x, so that each has an effect at the start."""
        lo, hi = float(x.min()), float(x.max())
        span = hi - lo if hi > lo else 1.0
        centre, dead, margin = middle(lo, hi), 0.02 * span, 0.05 * span
        return np.array([lo + margin, centre - dead, centre + dead, lo + span - margin, 1.0, 1.0])

    def straight(self, x: np.ndarray) -> np.ndarray:
        far = float(np.abs(x).max())
        return np.array([-2.0 * far, -NARROW * far, NARROW * far, 2.0 * far, 1.0, 1.0])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        turned = bool(a[0] < 0.0)
        return Law(self, block_diagonal(diagonal(a[0], 4, turned), diagonal(b[0] / a[0], 2, turned)))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        break_points, gains = np.repeat([1.0, 0.0], [4, 2]), np.repeat([0.0, 1.0], [4, 2])
        return [
            Symmetry(theta * (break_points - gains), in_scale=1.0),
            Symmetry(break_points, in_shift=1.0),
            Symmetry(theta * gains, out_scale=1.0),
        ]

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] < theta[1] <= theta[2] < theta[3])

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """A dead zone of negative width gets width zero: a map without a dead zone is also valid."""
        if theta[1] <= theta[2]:
            return theta
        closed = theta.copy()
        closed[1:3] = 0.5 * (theta[1] + theta[2])
        return closed

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        s_lo, d_lo, d_up, s_up, a_lo, a_up = theta
        middle = 0.5 * (d_lo + d_up)
        fresh_lo, fresh_up = middle + rng.uniform(0.4, 1.0, 2) * (np.array([s_lo, s_up]) - middle)
        dead = rng.uniform(0.02, 0.4, 2)
        return np.array(
            [
                fresh_lo,
                middle + dead[0] * (fresh_lo - middle),
                middle + dead[1] * (fresh_up - middle),
                fresh_up,
                a_lo * np.exp(rng.uniform(-0.5, 0.5)),
                a_up * np.exp(rng.uniform(-0.5, 0.5)),
            ]
        )

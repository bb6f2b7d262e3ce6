"""Static maps drawn at random, for signals of mean 0 and standard deviation 1."""

from collections.abc import Callable

import numpy as np

from sysid.block.block import StaticBlock
from sysid.blocks import (
    CubicSpline,
    DeadZone,
    DeadZoneSaturation,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    SigmoidNetwork,
)

Drawn = tuple[StaticBlock, np.ndarray]  # a map and its parameters


def saturation(rng: np.random.Generator) -> Drawn:
    """Slope 1 between two limits, one of which may be rarely met."""
    return Saturation(), np.array([-rng.uniform(0.4, 1.8), rng.uniform(0.4, 1.8)])


def dead_zone(rng: np.random.Generator) -> Drawn:
    """Slope 1 outside a zone without output."""
    return DeadZone(), np.array([-rng.uniform(0.1, 0.7), rng.uniform(0.1, 0.7)])


def dead_zone_saturation(rng: np.random.Generator) -> Drawn:
    """Dead zone, limits, and a slope for each side."""
    inner, outer, gains = rng.uniform(0.1, 0.6, 2), rng.uniform(0.6, 1.5, 2), rng.uniform(0.5, 2.0, 2)
    return DeadZoneSaturation(), np.array([-inner[0] - outer[0], -inner[0], inner[1], inner[1] + outer[1], *gains])


def four_kinks(rng: np.random.Generator) -> Drawn:
    """Rising line with three kinks; slopes differ by up to a factor of ten."""
    return _line(rng, np.sort(rng.uniform(-1.5, 1.5, 4)), 10 ** rng.uniform(-0.7, 0.3, 3))


def rough(rng: np.random.Generator) -> Drawn:
    """Rising line with nine knots."""
    return _line(rng, np.linspace(-2.0, 2.0, 9) + rng.uniform(-0.15, 0.15, 9), 10 ** rng.uniform(-0.7, 0.3, 8))


def step(rng: np.random.Generator) -> Drawn:
    """A slope that jumps by a factor of ten to forty over a short stretch."""
    centre, width = rng.uniform(-0.5, 0.5), rng.uniform(0.03, 0.1)
    slopes = np.array([0.4, rng.uniform(4.0, 16.0), 0.4])
    return _line(rng, np.array([-2.0, centre - width, centre + width, 2.0]), slopes)


def folding(rng: np.random.Generator) -> Drawn:
    """Falls, then rises: two inputs give one output."""
    knots = np.array([-2.0, rng.uniform(-0.6, 0.6), 2.0])
    return _line(rng, knots, np.array([-rng.uniform(0.4, 1.5), rng.uniform(0.4, 1.5)]))


def parabola(rng: np.random.Generator) -> Drawn:
    """Smooth, with its vertex among the data or at their edge."""
    return Polynomial(degree=2), np.array([rng.uniform(0.3, 0.8), rng.uniform(-1.0, 1.0), 0.0])


def cubic(rng: np.random.Generator) -> Drawn:
    """Rising cubic polynomial: slope c + 2 b x + 3 a x^2 with b^2 < 3 a c."""
    a, c = rng.uniform(0.05, 0.3), rng.uniform(0.3, 1.0)
    return Polynomial(degree=3), np.array([a, rng.uniform(-0.9, 0.9) * np.sqrt(3 * a * c), c, 0.0])


def sigmoid(rng: np.random.Generator) -> Drawn:
    """A sigmoid on a slope."""
    b = rng.uniform(1.5, 6.0)
    s = rng.uniform(1.0, 3.0)
    return SigmoidNetwork(units=1), np.array([-s / 2, rng.uniform(0.1, 0.5), s, b, b * rng.uniform(-0.5, 0.5)])


def smooth(rng: np.random.Generator) -> Drawn:
    """Monotone cubic spline of five knots."""
    spline = CubicSpline(knots=5, monotone=True, span=(-2.5, 2.5))
    return spline, np.array([-2.0, *(10 ** rng.uniform(-0.7, 0.5, len(spline.slots()) - 1))])


MAPS: dict[str, Callable[[np.random.Generator], Drawn]] = {
    each.__name__: each
    for each in (
        saturation, dead_zone, dead_zone_saturation, four_kinks, rough, step, folding, parabola, cubic, sigmoid, smooth
    )
}  # fmt: skip


def _line(rng: np.random.Generator, knots: np.ndarray, slopes: np.ndarray) -> Drawn:
    """Straight pieces with these slopes through a random offset at the middle knot; falling in half of the draws."""
    y = np.concatenate([[0.0], np.cumsum(slopes * np.diff(knots))])
    y = (y - np.interp(0.0, knots, y) + rng.uniform(-0.3, 0.3)) * rng.choice([-1.0, 1.0])
    return PiecewiseLinear(knots=len(knots)), np.concatenate([knots, y])

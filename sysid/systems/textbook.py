"""A textbook Hammerstein-Wiener plant: complex poles between a saturation and an output map with kinks."""

import numpy as np

from sysid.blocks import PiecewiseLinear
from sysid.model.system import System
from sysid.structures.hammerstein_wiener import hammerstein_wiener


def textbook() -> System:
    """Poles 0.75 +- 0.371i, gain 2.25, an input that saturates and an output map of three slopes."""
    chain = hammerstein_wiener(2, 2, 1, "saturation", PiecewiseLinear(knots=4))
    theta = np.array([-1.0, 1.4, 0.3, 0.15, -1.5, 0.7, 0.0, 0.0, -2.0, -0.8, 1.0, 3.0, -1.3, -0.9, 1.2, 1.9])
    return System("textbook", chain, theta, Ts=0.1, span=2.0, source="made for this library")

"""The paper's linear block of joint 3, equation (11) of Guni and Irawan 2016, between our own maps."""

import numpy as np

from sysid.blocks import PiecewiseLinear
from sysid.model.system import System
from sysid.structures.hammerstein_wiener import hammerstein_wiener


def paper_shank() -> System:
    """One pole at 0.985 and a delay of three samples; B is scaled to gain 1, the maps are our choice."""
    chain = hammerstein_wiener(3, 1, 3, "saturation", PiecewiseLinear(knots=4))
    b = np.array([-1.428, 3.285, -1.592]) / 0.265 * 0.0152
    maps = [-0.7, -0.2, 0.3, 0.7, -0.9, -0.2, 0.25, 0.9]
    theta = np.array([-1.2, 1.5, *b, -0.9848, 0.0, 0.0, 0.0, 0.0, 0.0, *maps])
    return System("paper_shank", chain, theta, Ts=0.1, span=2.0, source="Guni and Irawan 2016, eq. (11)")

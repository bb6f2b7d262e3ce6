"""The paper's linear block of joint 1, equation (7) of Guni and Irawan 2016, between our own maps."""

import numpy as np

from sysid.blocks import PiecewiseLinear
from sysid.model.system import System
from sysid.structures.hammerstein_wiener import hammerstein_wiener


def paper_shoulder() -> System:
    """Poles 0.960, -0.810, -0.645; the unpublished maps are our choice: a saturation and a line with a kink."""
    chain = hammerstein_wiener(3, 3, 1, "saturation", PiecewiseLinear(knots=4))
    b = np.array([-0.004334, 0.01507, 0.02719]) / 0.037926 * 0.1199  # gain 1: the output map has the rest
    f = [0.4951, -0.8738, -0.5013]
    maps = [-0.8, -0.3, 0.3, 0.8, -1.0, -0.3, 0.2, 0.9]
    theta = np.array([-1.2, 1.5, *b, *f, 0.0, 0.0, 0.0, *maps])
    return System("paper_shoulder", chain, theta, Ts=0.1, span=2.0, source="Guni and Irawan 2016, eq. (7)")

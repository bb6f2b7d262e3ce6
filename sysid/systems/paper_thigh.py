"""The paper's linear block of joint 2, equation (9) of Guni and Irawan 2016, between our own maps."""

import numpy as np

from sysid.blocks import PiecewiseLinear
from sysid.model.system import System
from sysid.structures.hammerstein_wiener import hammerstein_wiener


def paper_thigh() -> System:
    """Poles 0.995 and 0.981, slow and close; the unpublished maps are our choice."""
    chain = hammerstein_wiener(2, 2, 1, "saturation", PiecewiseLinear(knots=4))
    maps = [-1.5, -0.4, 0.5, 1.5, -1.2, -0.5, 0.6, 1.0]
    theta = np.array([-1.2, 1.5, -0.05067, 0.05058, -1.976, 0.9761, 0.0, 0.0, *maps])
    return System("paper_thigh", chain, theta, Ts=0.1, span=2.0, source="Guni and Irawan 2016, eq. (9)")

"""Linear models of a fit, as `control` objects, and the comparison of poles."""

from sysid.base import modules_of, poles
from sysid.linear.linearize import OperatingPoint, findop, linapp, tangent
from sysid.linear.modes import Gain, Mode, gain, modes
from sysid.linear.noise import Noise, noise_model
from sysid.linear.rates import Continuous, d2c, d2d

__all__ = [
    "Continuous",
    "Gain",
    "Mode",
    "Noise",
    "OperatingPoint",
    "d2c",
    "d2d",
    "findop",
    "gain",
    "linapp",
    "modes",
    "noise_model",
    "poles",
    "tangent",
]

__getattr__, __dir__ = modules_of(__name__)

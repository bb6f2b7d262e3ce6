"""Linear models of a fit, as `control` objects, and the comparison of poles."""

from sysid.base import poles
from sysid.base.room import modules_of
from sysid.linear.linearize import OperatingPoint, findop, linapp, tangent

__all__ = ["OperatingPoint", "findop", "linapp", "poles", "tangent"]

__getattr__, __dir__ = modules_of(__name__)

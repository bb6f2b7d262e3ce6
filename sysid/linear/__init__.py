"""Linear models of a fit, as `control` objects, and the comparison of poles."""

from sysid.base import poles
from sysid.linear.linearize import OperatingPoint, findop, linapp, tangent

__all__ = ["OperatingPoint", "findop", "linapp", "poles", "tangent"]

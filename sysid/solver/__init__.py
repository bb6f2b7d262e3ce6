"""The one iteration loop, the searches it asks for steps, and the covariance of what they find."""

from sysid.solver import searches

__all__ = ["searches"]

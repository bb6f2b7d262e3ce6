"""The iteration loop, the searches that give its steps, and the covariance of the result."""

from sysid.solver import searches

__all__ = ["searches"]

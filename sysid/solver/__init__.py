"""The iteration loop, the searches that give its steps, and the covariance of the result."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

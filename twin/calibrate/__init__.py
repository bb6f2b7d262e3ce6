"""Physical parameters of a simulation from records: what they tell, their values, and intervals."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""What the drawn scenarios are made of: maps, poles, inputs and noise, each drawn by name."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

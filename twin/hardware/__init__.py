"""The parts of the leg as numbers: motor, friction, drive, potentiometer, linkage."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

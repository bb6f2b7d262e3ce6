"""Joints of a user's own MJCF: driven with the commands of a log, calibrated, and written back."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""The whole quadruped: kinematics, gait, walk."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""A record from its file to finished numbers."""

from sysid.base.room import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""From the columns of a file to channels with units, and from time stamps to a uniform record."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

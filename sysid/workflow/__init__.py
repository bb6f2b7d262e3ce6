"""From a recorded file to final results, and to what to try next."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

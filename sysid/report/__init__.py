"""The pages of `identify`, `info`, `design`, `run` and `bench`: what they say first, their sections and figures."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

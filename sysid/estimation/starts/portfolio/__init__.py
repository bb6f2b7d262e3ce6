"""Starts that differ: where each comes from, how they are ranked, and how they become parameters of a chain."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""Basics of all rooms: errors, atomic files, plain values, threads, criteria, poles, the look of figures."""

from sysid.base.room import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""Basics of all rooms: errors, atomic files, plain values, threads, the journal, formulas of fit."""

from sysid.base.room import modules_of

__getattr__, __dir__ = modules_of(__name__)

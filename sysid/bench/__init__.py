"""Benchmark of the identifier on plants with known truth: `python -m sysid.bench run|report|speed`."""

from sysid.base.room import modules_of

__getattr__, __dir__ = modules_of(__name__)

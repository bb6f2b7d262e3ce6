"""Benchmark of identification methods against truth, peers and real records: `qpal bench`."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

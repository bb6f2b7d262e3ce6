"""Blocks in series: the chain, its gauge, its tangent at a steady state, its wiring."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""Uncertainty of a fit: standard deviations, intervals, bands, responses and curves with bands."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

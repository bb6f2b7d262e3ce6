"""Uncertainty of a fit: standard deviations, intervals, bands, responses and curves with bands."""

from sysid.uncertainty import bands, curves, information, intervals, responses

__all__ = ["bands", "curves", "information", "intervals", "responses"]

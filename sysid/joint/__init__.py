"""Actuated joints: all parts under their priors, and their values in physical units."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

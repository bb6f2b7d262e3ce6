"""Actuated joints: grown part by part, and told in physical units."""

from sysid.base.room import modules_of

__getattr__, __dir__ = modules_of(__name__)

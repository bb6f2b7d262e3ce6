"""Fits judged on unseen data: comparison and cross-validation."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

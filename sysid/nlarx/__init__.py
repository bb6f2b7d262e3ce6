"""Nonlinear ARX: the model, its fit one step ahead or in free run, its result."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

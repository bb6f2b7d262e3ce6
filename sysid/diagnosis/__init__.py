"""Tests on a record or on residuals: advice, whitening, residual tests, best linear approximation."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

"""Certified values: how many digits of them a method or the solver gives."""

"""Figures of a fit, each drawn from finished numbers."""

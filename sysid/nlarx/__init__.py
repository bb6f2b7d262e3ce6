"""Nonlinear ARX: the model, its fit one step ahead or in free run, its result."""

"""Actuated joints: growth part by part, and their values in physical units."""

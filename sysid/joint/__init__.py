"""Actuated joints: grown part by part, and told in physical units."""

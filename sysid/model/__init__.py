"""Blocks in series: the chain, its gauge, its tangent at a steady state, its wiring."""

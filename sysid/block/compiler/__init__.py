"""A block's recursion, written once as a step in a subset of Python, and everything derived from it.

`subset` reads a step into the small language of `ir` and reports what is not allowed. `kernel` makes the compiled
simulation, `tangent` its exact tangents. `fold` inserts numbers, `text` makes C99 and Python, `equations` makes
equations. `recursion` has the blocks made in this way.
"""

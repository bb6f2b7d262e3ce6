"""A block's recursion, written once as a plain step in a subset of Python, and what is derived from it.

`subset` reads a step into the small language of `ir`, and says in a sentence what it does not allow. From there come
the compiled simulation (`kernel`) with exact tangents (`tangent`), and with numbers put in (`fold`) C99 and Python
(`text`) and equations (`equations`). `recursion` holds the blocks that are made of all this.
"""

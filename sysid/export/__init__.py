"""A fit as other people's code: C99, Python, closed form."""

from sysid.export import c, closed_form, python

__all__ = ["c", "closed_form", "python"]

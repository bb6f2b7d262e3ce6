"""What results show in a notebook and at a prompt, and what else they do with rooms above their own; one class each.

`sysid.base.handlers` finds the class. Each has `line(thing)`, `card(thing)` and the methods of what it shows.
"""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

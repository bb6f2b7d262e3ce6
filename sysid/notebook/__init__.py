"""What results show in a notebook and at a prompt, and what else they do with rooms above their own; one class a file.

`sysid.base.handlers` finds the file of a class. Each has `line(thing)`, `card(thing)` and the class's own methods.
"""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

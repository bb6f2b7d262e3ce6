"""Structure search: structures, maps and orders judged on parts of a record, with a journal."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

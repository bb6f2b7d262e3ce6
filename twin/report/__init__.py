"""The reports of the verbs, from finished numbers."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

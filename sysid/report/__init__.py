"""The pages of `identify`, `info`, `design`, `run`, `models` and `bench`, their sections and figures."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

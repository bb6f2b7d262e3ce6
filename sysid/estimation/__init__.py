"""From a chain and a record to a `Fit`: objective, problem, initial states, starts, the fit and its file."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)

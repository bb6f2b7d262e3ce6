"""A log beside the twin, a model or a second log: where they depart, and which physical effect explains it."""

from sysid.base import modules_of
from twin.compare.comparison import Comparison, compare, compare_log, compare_model

__all__ = ["Comparison", "compare", "compare_log", "compare_model"]

__getattr__, __dir__ = modules_of(__name__)

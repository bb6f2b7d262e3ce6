"""One experiment over many seeds and drawn parameters."""

from sysid.base import modules_of
from twin.ensemble.draws import Draws
from twin.ensemble.ensemble import Ensemble

__all__ = ["Draws", "Ensemble"]

__getattr__, __dir__ = modules_of(__name__)

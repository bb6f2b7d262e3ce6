"""One experiment over many seeds and drawn parameters."""

from twin.ensemble.draws import Draws
from twin.ensemble.ensemble import Ensemble

__all__ = ["Draws", "Ensemble"]

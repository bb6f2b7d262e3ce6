"""Digital twin of the QPAL leg: simulate an excitation experiment, and know the truth behind its log."""

from twin.draws import Draws
from twin.ensemble import Ensemble
from twin.experiment import Experiment
from twin.leg import IMPERFECTIONS
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.truth import truth  # after this line `twin.truth` is the function; its module is imported from, never named

__all__ = ["IMPERFECTIONS", "JOINTS", "Draws", "Ensemble", "Experiment", "Log", "Parameters", "truth"]

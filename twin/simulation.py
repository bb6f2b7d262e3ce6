"""One excitation experiment with the truth behind it: what `qpal simulate` does."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import twin
from twin.log import Log
from twin.truth import Truth
from twin.versions import versions


@dataclass(frozen=True)
class Simulation:
    """A log of the twin and the truth of its joint."""

    log: Log
    truth: Truth

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest measured angle [rad]."""
        return float(self.log.y.min()), float(self.log.y.max())

    @property
    def resting(self) -> float:
        """Part of the record, 0 to 1, in which the joint lies within its backlash of an end."""
        assert self.log.y_true is not None
        lo, hi = self.truth.end_angles
        slack = self.truth.backlash + 1e-3
        return float(np.mean((self.log.y_true < lo + slack) | (self.log.y_true > hi - slack)))

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal simulate`, ready for JSON."""
        return {
            "joint": self.log.joint,
            "samples": self.log.N,
            "Ts": self.log.Ts,
            "angle_range": list(self.range),
            "resting_at_ends": self.resting,
            "log": dict(self.log.meta),
            "truth": self.truth.as_dict(),
            "versions": versions(),
        }


def simulate(experiment: twin.Experiment) -> Simulation:
    """Runs the experiment and looks up the truth of its joint."""
    return Simulation(experiment.run(), twin.truth(experiment.joint, experiment.Ts, experiment.parameters))

"""One excitation experiment with its truth, for `qpal simulate`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import twin
from sysid.base.files import versions
from sysid.data.record import IOData
from twin.follow import Follower
from twin.hardware.potentiometer import Potentiometer, potentiometer
from twin.log import Log
from twin.truth import Truth


@dataclass(frozen=True)
class Part:
    """One joint of an experiment: its record, the undisturbed potentiometer reading, and its truth."""

    joint: str
    data: IOData
    y_true: np.ndarray
    truth: Truth
    pot: Potentiometer

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest measured angle [rad]."""
        return float(self.data.y.min()), float(self.data.y.max())

    @property
    def resting(self) -> float:
        """Share of the record, 0 to 1, in which the joint is within its backlash of an end."""
        lo, hi = self.truth.end_angles
        slack = self.truth.backlash + self.pot.nonlinearity + 1e-3
        return float(np.mean((self.y_true < lo + slack) | (self.y_true > hi - slack)))


@dataclass(frozen=True)
class Simulation:
    """A log of the twin and its joints."""

    log: Log
    parts: tuple[Part, ...]

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal simulate`, ready for JSON; by joint if there are several."""
        return {
            "joint": self.log.joint,
            "samples": self.log.N,
            "Ts": self.log.Ts,
            "angle_range": self._by_joint({part.joint: list(part.range) for part in self.parts}),
            "resting_at_ends": self._by_joint({part.joint: part.resting for part in self.parts}),
            "log": dict(self.log.meta),
            "truth": self._by_joint({part.joint: part.truth.as_dict() for part in self.parts}),
            "versions": versions(),
        }

    def _by_joint(self, values: Mapping[str, Any]) -> Any:
        return values[self.log.joint] if self.log.joint in values else dict(values)


def simulate(experiment: twin.Experiment) -> Simulation:
    """Runs the experiment and adds the truth of its joints."""
    return _with_truth(experiment.run(), experiment.joints, experiment.Ts, experiment.p, experiment.without)


def follow(follower: Follower, parameters: twin.Parameters | None = None, seed: int = 1) -> Simulation:
    """The twin's own log under the input of a follower's log, with the truth of the joint.

    The truth is for the sampling time in whole milliseconds, the step of the simulation.
    """
    p = parameters or twin.Parameters()
    log = follower.record(p, seed)
    return _with_truth(log, (follower.joint,), max(round(log.Ts, 3), 1e-3), p, tuple(log.meta["without"]))


def _with_truth(
    log: Log, joints: tuple[str, ...], Ts: float, p: twin.Parameters, without: tuple[str, ...]
) -> Simulation:
    assert log.y_true is not None
    clean = log.y_true.reshape(log.N, -1)
    pot = potentiometer(p, without)
    parts = tuple(
        Part(joint, log.io(joint), clean[:, k], twin.truth(joint, Ts, p, log.mode), pot)
        for k, joint in enumerate(joints)
    )
    return Simulation(log, parts)

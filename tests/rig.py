"""The bench under a voltage that a test writes down, seen without noise."""

import numpy as np

from twin.experiment import Experiment, respond
from twin.imperfections import of_group
from twin.plant import slots
from twin.plant.slots import ANGLE, FORCE, READING, VOLTS

QUIET = tuple(name for name in of_group("sensor") if name != "nonlinearity")
# What stands between a command and the motor besides the limit switches.
IDEAL_BRIDGE = of_group("bridge")


def shown(
    joint: str, u: np.ndarray, without: tuple[str, ...] = (), start: float | None = None, **settings
) -> np.ndarray:
    """What the board shows (N, COLUMNS) of `joint` under u (N,) [V] held for Ts, 0.1 s unless given."""
    experiment = Experiment(joint, without=tuple({*QUIET, *without}), **settings)
    places = {} if start is None else {joint: start}
    return respond(experiment, np.asarray(u, dtype=float)[:, None], places)[:, 0]


def record(
    joint: str, u: np.ndarray, without: tuple[str, ...] = (), start: float | None = None, **settings
) -> np.ndarray:
    """Angle between the links (N,) [rad] at each sample."""
    return shown(joint, u, without, start, **settings)[:, ANGLE]


__all__ = ["ANGLE", "FORCE", "IDEAL_BRIDGE", "QUIET", "READING", "VOLTS", "record", "shown", "slots"]

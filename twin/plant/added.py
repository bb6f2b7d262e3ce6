"""What a drive may have beside its parameters: tables over angle, speed and time, which `twin.plant.reduced` reads."""

from dataclasses import dataclass

import numpy as np

from twin.hardware.linkage import end_angles
from twin.parameters import Parameters

# Rows of a table, all in volts at the motor or shares; zeros are a drive without additions.
(
    PUSH,  # [V] over angle: forward
    RUB,  # [V] over angle: more dry friction
    DRAG,  # [V] over speed: against the motion
    WEAKER,  # share of the voltage that is lost, over time
    HOTTER,  # share by which the resistance is larger, over time
) = range(5)
ROWS = 5
POINTS = 1201
_BEYOND = 0.1  # [rad] past the ends
_FASTER = 1.5  # times the speed without load


@dataclass(frozen=True)
class Grid:
    """Where the columns of tables (ROWS, POINTS) stand: angles of the joint [rad], speeds of the drive [rad/s] or [m/s]
    and times [s] from 0 on; each (POINTS,) and even."""

    angle: np.ndarray
    speed: np.ndarray
    time: np.ndarray

    @property
    def spans(self) -> np.ndarray:
        """First angle, range of angles, largest speed, last time (4,)."""
        return np.array([self.angle[0], np.ptp(self.angle), self.speed[-1], self.time[-1]])

    def zeros(self) -> np.ndarray:
        """The table (ROWS, POINTS) of a drive without additions."""
        return np.zeros((ROWS, POINTS))


@dataclass(frozen=True)
class Added:
    """A table (ROWS, POINTS) with the `spans` (4,) of the grid that it was made on."""

    table: np.ndarray
    spans: np.ndarray


NOTHING = Added(np.zeros((ROWS, 0)), np.ones(4))


def grid(p: Parameters, joint: str, seconds: float) -> Grid:
    """The grid of a joint with parameters `p` over a record of `seconds` [s]."""
    low, high = end_angles(p, joint)
    return Grid(
        np.linspace(low - _BEYOND, high + _BEYOND, POINTS),
        np.linspace(0.0, _FASTER * p[f"{joint}.no_load_speed"], POINTS),
        np.linspace(0.0, seconds, POINTS),
    )

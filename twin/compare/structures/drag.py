"""Friction that grows with speed, as grease makes it: size (v / top)^power against the motion.

`top` is 1.5 times the speed without load; a power of 1 is viscous friction, below 1 that of grease which thins as it is
sheared (Olsson et al., European Journal of Control 4, 1998, section 2).
"""

from collections.abc import Mapping

import numpy as np

from twin.compare.effects import Knob
from twin.compare.structures._declaration import structure
from twin.plant.added import DRAG, Grid

SIZE, POWER = "drag_size", "drag_power"


def drive(grid: Grid, values: Mapping[str, float]) -> np.ndarray:
    table = grid.zeros()
    table[DRAG] = values[SIZE] * (grid.speed / grid.speed[-1]) ** values[POWER]
    return table


DRAGS = structure(
    "drag",
    "friction that grows with speed",
    (
        Knob(SIZE, "V", 0.0, -5.0, 20.0, 0.3, (0.5, 2.0), words="friction at 1.5 times the speed without load"),
        Knob(POWER, "1", 0.7, 0.3, 2.5, 0.2, words="power of the speed"),
    ),
    "--excitation aprbs",
    "many levels between zero and the largest voltage, long enough to move at a steady speed",
    drive=drive,
)

"""A drive that weakens as it warms up: its voltage falls, or its winding's resistance grows, by 1 - exp(-t / time).

Copper's resistance grows by 0.39 % a degree (Hughes and Drury, Electric Motors and Drives, 5th ed. 2019, section 3.8).
"""

from collections.abc import Mapping

import numpy as np

from twin.compare.effects import Knob
from twin.compare.structures._declaration import structure
from twin.plant.added import HOTTER, WEAKER, Grid

VOLTS, RESISTANCE, TIME = "heat_volts", "heat_resistance", "heat_time"


def drive(grid: Grid, values: Mapping[str, float]) -> np.ndarray:
    table, warm = grid.zeros(), -np.expm1(-grid.time / values[TIME])
    table[WEAKER], table[HOTTER] = values[VOLTS] * warm, values[RESISTANCE] * warm
    return table


HEAT = structure(
    "heat",
    "a drive that weakens as it warms up",
    (
        Knob(VOLTS, "1", 0.0, -0.3, 0.8, 0.03, (0.1, 0.25), words="share of the voltage that it loses"),
        Knob(RESISTANCE, "1", 0.0, -0.3, 3.0, 0.1, (0.3,), words="share by which its resistance grows"),
        Knob(TIME, "s", 15.0, 4.0, 1000.0, 5.0, words="time constant"),
    ),
    "--excitation sweep --set jitter=0.5,shrink=0.4",
    "a long run, after which the same run is repeated cold",
    drive=drive,
)

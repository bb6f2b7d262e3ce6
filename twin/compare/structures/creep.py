"""A zero that creeps as something warms up: y = x + end (1 - exp(-t / time))."""

from collections.abc import Mapping

import numpy as np

from twin.compare.effects import Knob
from twin.compare.structures._declaration import DT, structure

END, TIME = "creep_end", "creep_time"


def read(x: np.ndarray, u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    t = np.arange(len(x)) * DT
    return np.asarray(x + values[END] * -np.expm1(-t / values[TIME]))


CREEP = structure(
    "creep",
    "a zero of the sensor that creeps",
    (
        Knob(END, "rad", 0.0, -1.0, 1.0, 0.01, words="creep in the end"),
        Knob(TIME, "s", 30.0, 1.0, 1000.0, 10.0, words="its time constant"),
    ),
    "--excitation sweep --set jitter=0.5,shrink=0.4",
    "a long run, after which the same run is repeated cold",
    read=read,
)

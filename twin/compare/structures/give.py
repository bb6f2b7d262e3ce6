"""A base or bearing that gives under the motor's force: y = x + give w,   time w' + w = u."""

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from twin.compare.effects import Knob
from twin.compare.structures._declaration import DT, structure

GIVE, TIME = "give", "give_time"


def read(x: np.ndarray, u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    keep = float(np.exp(-DT / max(values[TIME], 1e-6)))
    return np.asarray(x + values[GIVE] * lfilter([1.0 - keep], [1.0, -keep], u))


GIVES = structure(
    "give",
    "a base or bearing that gives under the motor's force",
    (
        Knob(GIVE, "rad/V", 0.0, -0.05, 0.05, 0.0005, (0.001, -0.001), words="give per volt"),
        Knob(TIME, "s", 0.05, 0.002, 1.0, 0.03, words="its time constant"),
    ),
    "--excitation staircase --set amplitude=3,hold=0.5,steps=60",
    "voltages below those that move the joint",
    read=read,
)

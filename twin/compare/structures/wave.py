"""A sensor off its centre: y = x + sine sin(turns x) + cosine cos(turns x), `turns` of the sensor for one of the joint.

The first harmonic of a disc or potentiometer that is mounted off its centre.
"""

from collections.abc import Mapping

import numpy as np

from twin.compare.effects import Knob
from twin.compare.structures._declaration import structure

SINE, COSINE, TURNS = "wave_sine", "wave_cosine", "wave_turns"


def read(x: np.ndarray, u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    angle = values[TURNS] * x
    return np.asarray(x + values[SINE] * np.sin(angle) + values[COSINE] * np.cos(angle))


WAVE = structure(
    "wave",
    "a sensor off its centre",
    (
        Knob(SINE, "rad", 0.0, -0.2, 0.2, 0.005, words="sine of the error"),
        Knob(COSINE, "rad", 0.0, -0.2, 0.2, 0.005, words="cosine of the error"),
        Knob(TURNS, "1", 4.0, 0.8, 60.0, 1.0, words="waves a turn of the joint"),
    ),
    "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
    "slow motion in both directions over the whole stroke",
    read=read,
    # As the error is wrong a wave further on, a search does not find the number of waves from afar.
    tries=[{TURNS: k, name: size} for k in np.arange(1.0, 60.0) for name in (SINE, COSINE) for size in (0.003, -0.003)],
)

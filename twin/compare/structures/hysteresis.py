"""A cable or belt that stretches with friction: it follows a reversal only after some way.

    y = x - stretch z,   dz/dx = (1 - z sign x') / way

Dahl's curve (Dahl, AIAA Journal 14, 1976): z goes from -1 to 1 over a few times `way` [rad] after a reversal.
"""

from collections.abc import Mapping

import numpy as np

from sysid.base.compiled import kernel
from twin.compare.effects import Knob
from twin.compare.structures._declaration import structure

STRETCH, WAY = "cable_stretch", "cable_way"


@kernel
def _dahl(x: np.ndarray, way: float) -> np.ndarray:
    z, out = 0.0, np.zeros(len(x))
    for k in range(1, len(x)):
        step = x[k] - x[k - 1]
        side = 1.0 if step > 0.0 else -1.0
        z = side + (z - side) * np.exp(-abs(step) / way)
        out[k] = z
    return out


def read(x: np.ndarray, u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    return np.asarray(x - values[STRETCH] * _dahl(x, max(values[WAY], 1e-6)))


HYSTERESIS = structure(
    "hysteresis",
    "a cable or belt that stretches with friction",
    (
        Knob(STRETCH, "rad", 0.0, -0.2, 0.2, 0.005, (0.004, 0.02), words="stretch"),
        Knob(WAY, "rad", 0.03, 1e-3, 0.5, 0.02, (0.07,), words="way over which it stretches"),
    ),
    "--excitation prbs --set amplitude=8",
    "many reversals in the middle of the stroke",
    read=read,
)

"""Two masses: the link hangs on a spring behind the drive.

    y'' + 2 d w (y' - x') + w^2 (y - x) = 0,   w = 1 / time

a mass whose base moves (Inman, Engineering Vibration, 4th ed. 2014, section 2.4).
"""

from collections.abc import Mapping

import numpy as np
from scipy.signal import bilinear, lfilter, lfilter_zi

from twin.compare.effects import Knob
from twin.compare.structures._declaration import DT, structure

TIME, DAMPING = "spring_time", "spring_damping"
_RIGID = 2.0 * DT  # [s]; a faster spring is none


def read(x: np.ndarray, u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    time, damping = max(values[TIME], 0.0), values[DAMPING]
    if time < _RIGID:
        return x
    b, a = bilinear([2.0 * damping * time, 1.0], [time**2, 2.0 * damping * time, 1.0], 1.0 / DT)
    return np.asarray(lfilter(b, a, x, zi=lfilter_zi(b, a) * x[0])[0])


SPRING = structure(
    "spring",
    "a link on a spring",
    (
        Knob(TIME, "s", 0.0, 0.0, 0.5, 0.01, words="time constant of the spring"),
        Knob(DAMPING, "1", 0.1, 0.002, 1.0, 0.05, words="its damping ratio"),
    ),
    "--excitation prbs --ts 0.02",
    "fast switching at a short sampling time, after which a spring rings",
    read=read,
    tries=[{TIME: time, DAMPING: d} for time in np.geomspace(0.004, 0.2, 40).tolist() for d in (0.03, 0.1, 0.4)],
)

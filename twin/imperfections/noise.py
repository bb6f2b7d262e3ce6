"""Measurement noise."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from twin.declared import GUESS, Imperfection, OfJoint, Row


class Noise(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "noise", "sensor"
    title = "Measurement noise"
    about = "Wiper and wires pick up noise."
    model = "white Gaussian noise on every reading; the log's and, in servo mode, the position loop's are drawn apart."
    parameters = "`pot_noise`."
    rows = (
        Row(
            "pot_noise",
            np.deg2rad(0.2),
            0,
            0.1,
            "rad",
            GUESS,
            "pot: standard deviation of white noise on a reading",
            compiled=False,
        ),
    )
    ideal: ClassVar[Mapping[str, float]] = {"pot_noise": 0.0}
    joint: ClassVar[Mapping[str, OfJoint]] = {"POT_NOISE": lambda p, joint: p["pot_noise"]}

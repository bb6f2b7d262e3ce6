"""Measurement noise."""

from typing import ClassVar

import numpy as np

from twin.imperfections._declaration import Imperfection, board_row


class Noise(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "noise", "sensor"
    title = "Measurement noise"
    about = "The wiper and the wires of the potentiometer add noise."
    model = "white Gaussian noise on every reading; in servo mode the position loop has independent noise."
    parameters = "`pot_noise`."
    rows = (
        board_row("pot_noise", np.deg2rad(0.2), 0, 0.1, "rad", "pot: standard deviation of white noise on a reading"),
    )
    ideal: ClassVar = {"pot_noise": 0.0}
    joint: ClassVar = {"POT_NOISE": "pot_noise"}

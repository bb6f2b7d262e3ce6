"""Nonlinear potentiometer."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class Nonlinearity(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "nonlinearity", "sensor"
    title = "Nonlinear potentiometer"
    about = "The resistive track of a potentiometer is not uniform."
    model = "an angle a is read as a + pot_linearity pot_range sin(2 pi 3 a / pot_range)."
    parameters = "`pot_linearity`, `pot_range`."
    rows = (
        board_row(
            "pot_linearity", 0.001, 0, 0.01, "1", "pot: largest deviation from a straight line, as a share of pot_range"
        ),
    )
    ideal: ClassVar = {"pot_linearity": 0.0}

"""Nonlinear potentiometer."""

from typing import ClassVar

from twin.imperfections._declaration import GUESS, Imperfection, Row


class Nonlinearity(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "nonlinearity", "sensor"
    title = "Nonlinear potentiometer"
    about = "The resistive track of a potentiometer is not uniform."
    model = "an angle a is read as a + pot_linearity pot_range sin(2 pi 3 a / pot_range)."
    parameters = "`pot_linearity`, `pot_range`."
    rows = (
        Row(
            "pot_linearity",
            0.001,
            0,
            0.01,
            "1",
            GUESS,
            "pot: largest deviation from a straight line, as a share of pot_range",
            compiled=False,
        ),
    )
    ideal: ClassVar = {"pot_linearity": 0.0}

"""Nonlinear potentiometer."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import GUESS, Imperfection, Row


class Nonlinearity(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "nonlinearity", "sensor"
    title = "Nonlinear potentiometer"
    about = "A resistive track is not equally thick everywhere."
    model = "an angle a shows as a + pot_linearity pot_range sin(2 pi 3 a / pot_range)."
    parameters = "`pot_linearity`, `pot_range`."
    rows = (
        Row(
            "pot_linearity",
            0.001,
            0,
            0.01,
            "1",
            GUESS,
            "pot: largest deviation from a straight line, part of pot_range",
            compiled=False,
        ),
    )
    ideal: ClassVar[Mapping[str, float]] = {"pot_linearity": 0.0}

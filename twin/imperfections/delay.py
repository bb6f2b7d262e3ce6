"""Transport delay."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import GUESS, Imperfection, Row


class Delay(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "delay", "bridge"
    title = "Transport delay"
    about = "A command travels over a bus and waits until the board looks at it."
    model = (
        "commands are held back by whole milliseconds; then they wait for the board's next look, every switch_period."
    )
    parameters = "`delay`, `switch_period`."
    rows = (
        Row(
            "delay",
            0.02,
            0,
            1,
            "s",
            GUESS,
            "drive: from a command's time stamp to the board, which looks once a switch_period",
            compiled=False,
        ),
    )
    ideal: ClassVar[Mapping[str, float]] = {"delay": 0.0}

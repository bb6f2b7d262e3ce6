"""Transport delay."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class Delay(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "delay", "bridge"
    title = "Transport delay"
    about = "A command is sent over a bus and waits until the board reads it."
    model = (
        "commands are delayed by whole milliseconds; then they wait for the board's next reading, every switch_period."
    )
    parameters = "`delay`, `switch_period`."
    rows = (
        board_row(
            "delay",
            0.02,
            0,
            1,
            "s",
            "drive: from a command's time stamp to the board, which reads commands every switch_period",
        ),
    )
    ideal: ClassVar = {"delay": 0.0}

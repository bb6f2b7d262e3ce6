"""Dead zone."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class DeadBand(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "dead_band", "bridge"
    title = "Dead zone of the bridge"
    about = "A bridge waits between switching its two transistors; this dead time shortens every pulse."
    model = "a duty ratio d becomes sign(d) max(|d| − dead_band / supply_voltage, 0)."
    parameters = "`dead_band`."
    rows = (
        board_row("dead_band", 0.3, 0, 3, "V", "drive: voltage that a command loses to the dead time of the bridge"),
    )
    ideal: ClassVar = {"dead_band": 0.0}
    board: ClassVar = {"DEAD_BAND": "dead_band"}

"""Sag of the supply."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class Sag(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "sag", "bridge"
    title = "Supply voltage drop"
    about = "All joints share the resistance of the supply and its wires."
    model = "the bus has V = V0 − R sum of d i over the joints, i = (d V − K w) / Ra, solved for V in each step."
    parameters = "`supply_resistance`."
    rows = (
        board_row(
            "supply_resistance", 1.0, 0, 10, "Ohm", "drive: resistance of supply and wires, shared by all joints"
        ),
    )
    ideal: ClassVar = {"supply_resistance": 0.0}
    board: ClassVar = {"SUPPLY_R": "supply_resistance"}

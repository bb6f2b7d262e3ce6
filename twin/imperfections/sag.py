"""Sag of the supply."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import GUESS, Imperfection, OfBoard, Row


class Sag(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "sag", "bridge"
    title = "Sag of the supply"
    about = "Supply and wires have a resistance, and all joints share it."
    model = "the bus has V = V0 − R sum of d i over the joints, i = (d V − K w) / Ra, solved for V in each step."
    parameters = "`supply_resistance`."
    rows = (
        Row(
            "supply_resistance",
            1.0,
            0,
            10,
            "Ohm",
            GUESS,
            "drive: supply and wires, shared by all joints; the supply sags",
            compiled=False,
        ),
    )
    ideal: ClassVar[Mapping[str, float]] = {"supply_resistance": 0.0}
    board: ClassVar[Mapping[str, OfBoard]] = {"SUPPLY_R": lambda p: p["supply_resistance"]}

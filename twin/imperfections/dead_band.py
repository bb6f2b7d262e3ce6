"""Dead band."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import GUESS, Imperfection, OfBoard, Row


class DeadBand(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "dead_band", "bridge"
    title = "Dead band"
    about = "Between its two transistors a bridge waits, and every pulse loses that time."
    model = "a duty d becomes sign(d) max(|d| − dead_band / supply_voltage, 0)."
    parameters = "`dead_band`."
    rows = (
        Row(
            "dead_band",
            0.3,
            0,
            3,
            "V",
            GUESS,
            "drive: volts that the bridge's dead time takes from a command",
            compiled=False,
        ),
    )
    ideal: ClassVar[Mapping[str, float]] = {"dead_band": 0.0}
    board: ClassVar[Mapping[str, OfBoard]] = {"DEAD_BAND": lambda p: p["dead_band"]}

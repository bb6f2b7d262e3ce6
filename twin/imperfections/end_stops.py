"""End stops."""

from collections.abc import Mapping
from math import inf
from typing import ClassVar

from twin.declared import Imperfection


class EndStops(Imperfection):
    """A switch infinitely far outside never trips. The hard stops are taken out in `twin.plant.leg`."""

    name, group = "end_stops", "mechanics"
    title = "End stops"
    about = (
        "A limit switch near each end of the stroke cuts the motor in the outward direction; what then coasts on "
        "meets a hard stop."
    )
    model = (
        "a range on the actuator's length (the shoulder: on its angle), and switches in the board that trip "
        "switch_margin before it. The shorted motor brakes. The link may pass the end by half of the play."
    )
    parameters = (
        "`JOINT.switch_margin`; `thigh.retracted_length`, `thigh.stroke`, the same for the shank; `shoulder.lower`, "
        "`shoulder.upper`."
    )
    ideal: ClassVar[Mapping[str, float]] = {"JOINT.switch_margin": -inf}

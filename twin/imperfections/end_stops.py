"""End stops."""

from math import inf
from typing import ClassVar

from twin.imperfections._declaration import Imperfection


class EndStops(Imperfection):
    """A limit switch at infinity never trips. `twin.plant.leg` removes the hard stops."""

    name, group = "end_stops", "mechanics"
    title = "End stops"
    about = (
        "A limit switch near each end of the stroke disconnects the motor in the outward direction. The mechanism "
        "coasts on and may reach a hard stop."
    )
    model = (
        "a range of the actuator's length (shoulder: of its angle), and switches in the board that trip "
        "switch_margin before it. The shorted motor brakes. The link may pass the end by half the backlash."
    )
    parameters = (
        "`JOINT.switch_margin`; `thigh.retracted_length`, `thigh.stroke`, the same for the shank; `shoulder.lower`, "
        "`shoulder.upper`."
    )
    ideal: ClassVar = {"JOINT.switch_margin": -inf}

"""Weight."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, Row


class Gravity(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "gravity", "mechanics"
    title = "Weight"
    about = (
        "The weight of the links loads thigh and shank; the shoulder's axis is vertical, so gravity does not load it."
    )
    model = (
        "MuJoCo's gravity on the masses of the links. In the picture all friction is switched off: only the shorted "
        "motor brakes, and the speed gives the force. With its friction the screw holds the leg."
    )
    parameters = "`gravity`; `thigh_mass`, `shank_mass`, `foot_mass`, `actuator_mass`."
    rows = (Row("gravity", 9.81, 0, 20, "m/s2", "standard", "option gravity"),)
    ideal: ClassVar = {"gravity": 0.0}

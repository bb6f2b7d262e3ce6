"""Direction-dependent friction."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection


class Asymmetry(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "asymmetry", "friction"
    title = "Direction-dependent friction"
    about = (
        "The friction of gears and screws usually depends on the direction. The joint then drifts under a voltage "
        "that is up and down for equal times."
    )
    model = "Coulomb friction is (1 + asymmetry) times its mean upwards and (1 − asymmetry) times its mean downwards."
    parameters = "`JOINT.asymmetry`."
    ideal: ClassVar = {"JOINT.asymmetry": 0.0}

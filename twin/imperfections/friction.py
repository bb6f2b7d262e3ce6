"""Coulomb and viscous friction."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import Imperfection


class Friction(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "friction", "friction"
    title = "Coulomb and viscous friction"
    about = (
        "Screw, gear and bearing rub: a part that does not ask how fast, and a part that grows with speed. The switch"
        " takes all of it, and with it the three that follow."
    )
    model = (
        "a dry-friction row in MuJoCo's solver, so that standing still is a true state, and linear damping; one pair "
        "for the actuator, one for the joint's bearing. The picture has K (V − K w) / R, what a motor at steady speed"
        " w must give."
    )
    parameters = "`JOINT.coulomb`, `JOINT.viscous`, `JOINT.bearing_coulomb`, `JOINT.bearing_viscous`."
    ideal: ClassVar[Mapping[str, float]] = {
        "JOINT.coulomb": 0.0,
        "JOINT.viscous": 0.0,
        "JOINT.bearing_coulomb": 0.0,
        "JOINT.bearing_viscous": 0.0,
        "JOINT.load_friction": 0.0,
    }

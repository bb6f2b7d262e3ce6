"""Coulomb and viscous friction."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection


class Friction(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "friction", "friction"
    title = "Coulomb and viscous friction"
    about = (
        "Screw, gear and bearing have friction: one part is independent of the speed, the other grows with it. The "
        "switch removes both, and the three imperfections below."
    )
    model = (
        "a dry-friction constraint in MuJoCo's solver, so that the joint can stick, and linear damping; one pair "
        "for the actuator, one for the joint's bearing. The picture shows K (V − K w) / R, the torque of a motor "
        "at steady speed w."
    )
    parameters = "`JOINT.coulomb`, `JOINT.viscous`, `JOINT.bearing_coulomb`, `JOINT.bearing_viscous`."
    ideal: ClassVar = {
        "JOINT.coulomb": 0.0,
        "JOINT.viscous": 0.0,
        "JOINT.bearing_coulomb": 0.0,
        "JOINT.bearing_viscous": 0.0,
        "JOINT.load_friction": 0.0,
    }

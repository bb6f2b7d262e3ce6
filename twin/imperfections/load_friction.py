"""Friction that grows with the load."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import Imperfection, OfJoint


class LoadFriction(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "load_friction", "friction"
    title = "Friction that grows with the load"
    about = "What a screw carries presses its threads together."
    model = (
        "load_friction times the force between actuator and link, averaged over 5 ms, is added to Coulomb friction. "
        "Lifting has efficiency 1 / (1 + load_friction); from 1 on no load drives the screw back (Budynas and "
        "Nisbett, Shigley's Mechanical Engineering Design, 10th edition, section 8-2). In the picture Coulomb "
        "friction is raised, so that the leg hangs still without the switch's part too."
    )
    parameters = "`JOINT.load_friction`."
    ideal: ClassVar[Mapping[str, float]] = {"JOINT.load_friction": 0.0}
    joint: ClassVar[Mapping[str, OfJoint]] = {"LOAD_FRICTION": lambda p, joint: p[f"{joint}.load_friction"]}

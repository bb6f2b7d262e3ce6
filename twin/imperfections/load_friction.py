"""Friction that grows with the load."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import Imperfection, OfJoint


class LoadFriction(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "load_friction", "friction"
    title = "Load-dependent friction"
    about = "The load of a screw presses its threads together."
    model = (
        "load_friction times the force between actuator and link, averaged over 5 ms, is added to Coulomb friction. "
        "The efficiency when lifting is 1 / (1 + load_friction); from 1 on the screw is self-locking (Budynas and "
        "Nisbett, Shigley's Mechanical Engineering Design, 10th edition, section 8-2). In the picture Coulomb "
        "friction is higher, so that the leg also stands still without this imperfection."
    )
    parameters = "`JOINT.load_friction`."
    ideal: ClassVar[Mapping[str, float]] = {"JOINT.load_friction": 0.0}
    joint: ClassVar[Mapping[str, OfJoint]] = {"LOAD_FRICTION": lambda p, joint: p[f"{joint}.load_friction"]}

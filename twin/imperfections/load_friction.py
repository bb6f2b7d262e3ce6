"""Friction that grows with the load."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection


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
    ideal: ClassVar = {"JOINT.load_friction": 0.0}
    joint: ClassVar = {"LOAD_FRICTION": "JOINT.load_friction"}

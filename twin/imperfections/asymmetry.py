"""Friction that differs up and down."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import Imperfection


class Asymmetry(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "asymmetry", "friction"
    title = "Friction that differs up and down"
    about = (
        "Gears and screws seldom run equally well both ways. A voltage that is as long up as down then makes the "
        "joint wander."
    )
    model = "Coulomb friction is (1 + asymmetry) times its mean up, (1 − asymmetry) times down."
    parameters = "`JOINT.asymmetry`."
    ideal: ClassVar[Mapping[str, float]] = {"JOINT.asymmetry": 0.0}

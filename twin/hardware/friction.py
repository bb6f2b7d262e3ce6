"""Dry friction of an actuator: Coulomb per direction, Stribeck, and the part that grows with axial load."""

from collections.abc import Collection
from dataclasses import dataclass

from twin.parameters import Parameters


@dataclass(frozen=True)
class DryFriction:
    """Friction force at the drive, rod [N] or shoulder [N m], against motion at speed v under axial load W:

        (1 + stribeck exp(-(v / stribeck_speed)^2)) C + load |W|,   C = up against motion up, down against motion down

    (Stribeck curve: Olsson et al., Friction models and friction compensation, European Journal of Control 4, 1998, eq.
    4). A power screw loses a share of its load: lifting has the efficiency 1 / (1 + load), and for `load` of at least
    1 the screw is self-locking (Budynas and Nisbett, Shigley's Mechanical Engineering Design, 10th ed., section 8-2).
    """

    up: float
    down: float
    stribeck: float
    stribeck_speed: float
    load: float

    def static(self, direction: int, load: float) -> float:
        """Break-away force of motion up (1) or down (-1) [N or N m] under axial load [N or N m]."""
        return (1.0 + self.stribeck) * (self.up if direction > 0 else self.down) + self.load * abs(load)


def dry_friction(parameters: Parameters, joint: str, without: Collection[str] = ()) -> DryFriction:
    """The dry friction of `joint`, with the parts that are not switched off."""
    values = parameters.switched_off(without)
    coulomb, tilt, *others = (
        values[f"{joint}.{name}"] for name in ("coulomb", "asymmetry", "stribeck", "stribeck_speed", "load_friction")
    )
    return DryFriction(coulomb * (1.0 + tilt), coulomb * (1.0 - tilt), *others)

"""Motor profile: a motor whose friction and load are free functions of its position."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.blocks import ProfiledMotor
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe, number, order


def motor_profile(knots: int = 9, low: float = 0.0, high: float = 1.0, **limits: Any) -> Chain:
    """Voltage to position of a motor with inertia, drag, and friction each way at `knots` places from low to high.

    low and high [unit of the output] are the ends of its way, see `ProfiledMotor`. Made to predict, not to be read:
    a fit trades dry friction for drag where the record does not tell them apart. `limits` are the `fixed` and `bounds`
    of the chain, by parameter.
    """
    return Chain((ProfiledMotor(knots, low, high, role="motor"),), structure="motor_profile", **limits)


@dataclass(frozen=True)
class MotorProfile(Recipe):
    """Settings of `motor_profile`."""

    name: ClassVar[str] = "motor_profile"
    searched: ClassVar[bool] = True
    zero: ClassVar[str] = "volts and positions"
    knots: int = order(9, "places of the friction profile", least=1)
    low: float = number(0.0, "lower end of the way of a motor with a friction profile", unit="Y")
    high: float = number(1.0, "upper end of the way of a motor with a friction profile", unit="Y")

    @classmethod
    def ladder(cls, data: IOData) -> tuple[Recipe, ...]:
        """Few and many places over the range of the record."""
        low, high = float(data.y.min()), float(data.y.max())
        return tuple(cls(knots, low, high) for knots in (5, 9))

    def neighbours(self) -> tuple[Recipe, ...]:
        """Twice or half the places."""
        return tuple(replace(self, knots=knots) for knots in (2 * self.knots - 1, (self.knots + 1) // 2) if knots > 1)

    def model(self) -> Chain:
        return motor_profile(self.knots, self.low, self.high)

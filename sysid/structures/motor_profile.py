"""Motor profile: a motor whose friction and load are free functions of its position."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.blocks import ProfiledMotor
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe, choice, number, order


@checked
def motor_profile(
    knots: int = 9,
    low: float | None = None,
    high: float | None = None,
    delayed: bool = False,
    period: float | None = None,
    **limits: Any,
) -> Chain:
    """Voltage to position of a motor with inertia, drag, and friction each way at `knots` places from low to high.

    low and high [unit of the output] are the ends of its way, by default the range of the record, and period is the
    length of a turn; where the way is a turn the profile repeats, see `ProfiledMotor`. `delayed`: the input acts late.
    Made to predict, not to be read: a fit trades dry friction for drag where the record does not tell them apart.
    `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    motor = ProfiledMotor(knots, low, high, delayed=delayed, period=period or 0.0, midway=True, role="motor")
    return Chain((motor,), structure="motor_profile", **limits)


@checked
@dataclass(frozen=True)
class MotorProfile(Recipe):
    """Settings of `motor_profile`."""

    name: ClassVar[str] = "motor_profile"
    searched: ClassVar[bool] = True
    zero: ClassVar[str] = "volts and positions"
    moves: ClassVar[bool] = True
    knots: int = order(9, "places of the friction profile", least=1)
    low: float | None = number(None, "lower end of a motor's friction profile [that of the record]", unit="Y")
    high: float | None = number(None, "upper end of a motor's friction profile [that of the record]", unit="Y")
    period: float | None = number(None, "a turn, over which a motor's friction profile repeats", unit="Y")
    delay: str = choice("none", "whether a profiled motor's input acts late", ("none", "found"))

    @classmethod
    @checked
    def ladder(cls, data: IOData) -> tuple[Recipe, ...]:
        """Few and many places over the range of the record, and a delay."""
        low, high = float(data.y.min()), float(data.y.max())
        return (cls(5, low, high), cls(9, low, high), cls(9, low, high, delay="found"))

    def neighbours(self) -> tuple[Recipe, ...]:
        """Twice or half the places, with and without a delay."""
        alternative = replace(self, delay="none" if self.delay == "found" else "found")
        return (
            *(replace(self, knots=knots) for knots in (2 * self.knots - 1, (self.knots + 1) // 2) if knots > 1),
            alternative,
        )

    def model(self) -> Chain:
        return motor_profile(self.knots, self.low, self.high, self.delay == "found", self.period)

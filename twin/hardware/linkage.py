"""Joint angle against actuator length, in closed form: the triangle of joint axis, base pin and rod pin."""

from dataclasses import dataclass
from typing import overload

import numpy as np

from sysid.base.errors import InputError
from twin.parameters import Parameters

# The MJCF's: between the pins of the thigh, from the knee to the foot's centre, and the foot's radius [m].
THIGH, SHANK, FOOT = 0.24, 0.24, 0.02


@dataclass(frozen=True)
class Linkage:
    """A linear actuator across a joint. Base and rod pins lie `base` and `rod` [m] from the axis; they enclose
    `offset + q` [rad] at joint angle q, which grows as the actuator extends."""

    base: float
    rod: float
    offset: float

    @overload
    def length(self, q: float) -> float: ...
    @overload
    def length(self, q: np.ndarray) -> np.ndarray: ...
    def length(self, q):
        """Distance between the pins [m] at joint angle q [rad], by the law of cosines."""
        return np.sqrt(self.base**2 + self.rod**2 - 2 * self.base * self.rod * np.cos(self.offset + q))

    def arm(self, q: float) -> float:
        """Moment arm dL/dq [m] at joint angle q [rad]."""
        return self.base * self.rod * np.sin(self.offset + q) / self.length(q)

    def angle(self, length: float) -> float:
        """Joint angle [rad] at which the pins are `length` [m] apart; raises InputError if that is impossible."""
        cosine = (self.base**2 + self.rod**2 - length**2) / (2 * self.base * self.rod)
        if not -1 < cosine < 1:
            raise InputError(
                f"the actuator cannot be {length:.4f} m long between pins {self.base:.4f} and {self.rod:.4f} m from "
                f"the joint; keep its length between {abs(self.base - self.rod):.4f} and {self.base + self.rod:.4f} m"
            )
        return float(np.arccos(cosine)) - self.offset


def linkage(parameters: Parameters, joint: str) -> Linkage:
    """The triangle of `joint` (thigh or shank)."""
    p = parameters
    return Linkage(
        p[f"{joint}.base_radius"], p[f"{joint}.rod_radius"], p[f"{joint}.base_angle"] - p[f"{joint}.rod_angle"]
    )


def stroke(parameters: Parameters, joint: str) -> tuple[float, float]:
    """Ends of travel of the drive side of `joint`: tendon lengths [m], or angles [rad] for the shoulder."""
    if joint == "shoulder":
        return parameters["shoulder.lower"], parameters["shoulder.upper"]
    shortest = parameters[f"{joint}.retracted_length"]
    return shortest, shortest + parameters[f"{joint}.stroke"]


def end_angles(parameters: Parameters, joint: str) -> tuple[float, float]:
    """Joint angles [rad] at the two ends of travel, the backlash centred."""
    low, high = stroke(parameters, joint)
    if joint == "shoulder":
        return low, high
    triangle = linkage(parameters, joint)
    return triangle.angle(low), triangle.angle(high)


def middle(parameters: Parameters, joint: str) -> float:
    """Joint angle [rad] at mid stroke: half the actuator's travel, not half the joint's."""
    low, high = stroke(parameters, joint)
    return (low + high) / 2 if joint == "shoulder" else linkage(parameters, joint).angle((low + high) / 2)


def clearance(parameters: Parameters) -> float:
    """Height [m] of the bench's foot over the floor with all joints at mid stroke; negative inside the floor."""
    thigh, shank = (middle(parameters, joint) for joint in ("thigh", "shank"))
    reach = THIGH * np.sin(thigh) + SHANK * np.cos(thigh + shank) + FOOT
    return float(parameters["bench_height"] - reach)

"""Commanded voltage to motor voltage: the supply's limit and the limit switches."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin.geometry import stroke
from twin.parameters import Parameters


@dataclass(frozen=True)
class Drive:
    """H-bridge with a limit switch at each end, read every `period` [s].

    `lower` and `upper` are where the switches trip, in tendon length [m] or, for the shoulder, drive-side angle [rad].
    A tripped switch puts the bridge to 0 V (both low sides on, so that back-EMF brakes) as long as the command points
    outward; inward it does nothing. PWM ripple, dead band and supply sag are not modelled.
    """

    supply: float
    lower: float
    upper: float
    period: float

    def voltage(self, command: float, position: float) -> float:
        """Motor voltage [V] for a commanded voltage [V] at a position [m or rad]."""
        volts = min(max(command, -self.supply), self.supply)
        if (volts > 0 and position >= self.upper) or (volts < 0 and position <= self.lower):
            return 0.0
        return volts


def drive(parameters: Parameters, joint: str, without: Collection[str] = ()) -> Drive:
    """The drive of `joint`; without end stops its switches never trip."""
    low, high = stroke(parameters, joint)
    margin = parameters[f"{joint}.switch_margin"]
    lower, upper = (-np.inf, np.inf) if "end_stops" in without else (low + margin, high - margin)
    return Drive(parameters["supply_voltage"], lower, upper, parameters["switch_period"])

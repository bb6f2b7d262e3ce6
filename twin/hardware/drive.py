"""The drive of a joint: supply, H-bridge, limit switches and the driver's own position loop, as numbers.

`twin.plant.kernels` runs them within the simulation.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin.hardware.linkage import stroke
from twin.imperfections.pwm import levels
from twin.parameters import Parameters

MODES = ("voltage", "servo")


@dataclass(frozen=True)
class Drive:
    """H-bridge on a supply that all joints share, with a limit switch at each end, read every `period` [s].

    A command is limited to plus and minus `supply` [V], rounded to one of `levels` PWM levels (0: none) and reduced by
    `dead_band` [V], the loss from the bridge's dead time. The supply sags by `resistance` [Ohm] times
    its current. PWM ripple is not modelled: the rotor does not follow it.

    The switches trip at `lower` and `upper`, in tendon length [m] or, for the shoulder, drive-side angle [rad].
    A tripped switch puts the bridge to 0 V (both low sides on, so that back-EMF brakes) as long as the command points
    outward; inward it does nothing.

    kp [V/V], ki [V/(V s)], kd [V s/V] make the position loop of servo mode, on the potentiometer's voltage.
    """

    supply: float
    resistance: float
    levels: int
    dead_band: float
    lower: float
    upper: float
    period: float
    kp: float
    ki: float
    kd: float

    @property
    def step(self) -> float | None:
        """Distance between the levels of the bridge [V], None if there are none."""
        return self.supply / self.levels if self.levels else None

    def command(self, volts: float, resistance: float) -> float:
        """The command [V] that puts `volts` [V] on a stalled motor of `resistance` [Ohm]; without PWM levels.

        Raises ValueError if the supply is too low. With duty d the bus is V0 / (1 + d^2 R / Ra).
        """
        ratio = self.resistance / resistance
        root = self.supply**2 - 4.0 * ratio * volts**2
        if root < 0.0:
            raise ValueError(f"a supply of {self.supply} V cannot put {volts} V on the motor")
        duty = 2.0 * volts / (self.supply + np.sqrt(root))
        return float(duty * self.supply + np.sign(volts) * self.dead_band)


def drive(parameters: Parameters, joint: str, without: Collection[str] = ()) -> Drive:
    """The drive of `joint`, with the parts that are not switched off."""
    p = parameters.switched_off(without)
    low, high = stroke(parameters, joint)
    margin = p[f"{joint}.switch_margin"]
    return Drive(
        p["supply_voltage"],
        p["supply_resistance"],
        levels(p["pwm_bits"]),
        p["dead_band"],
        low + margin,
        high - margin,
        p["switch_period"],
        *(p[f"{joint}.servo_{gain}"] for gain in ("kp", "ki", "kd")),
    )

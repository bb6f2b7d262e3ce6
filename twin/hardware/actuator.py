"""An actuator as numbers: the motor with its gear, the dry friction, and the drive that feeds it.

The drive is supply, H-bridge, limit switches and the driver's own position loop, which `twin.plant.electronics` runs
within the simulation.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from twin.hardware.linkage import stroke
from twin.imperfections.pwm import levels
from twin.parameters import Parameters

# Below these a drive side has almost no mass, and the stiff stops of the backlash make the simulation inaccurate.
LIGHTEST = {"shoulder": 0.01, "thigh": 1.0, "shank": 1.0}  # [kg m2], [kg]: rotor at the output
QUICKEST = 1e-4  # [s]: J R / K^2


@dataclass(frozen=True)
class Motor:
    """A DC motor with its gear. "Output" is the rod of a linear actuator [m, N], or the shoulder joint [rad, N m].

    constant [V s/rad = N m/A] and resistance [Ohm] are the motor's own; gear is rotor angle per output; inertia is the
    rotor's [kg m2].
    """

    constant: float
    resistance: float
    gear: float
    inertia: float

    @property
    def reflected_inertia(self) -> float:
        """Rotor inertia seen at the output, J gear^2 [kg or kg m2]."""
        return self.inertia * self.gear**2

    @property
    def damping(self) -> float:
        """Braking by back-EMF at the output, (K gear)^2 / R [N s/m or N m s/rad]."""
        return (self.constant * self.gear) ** 2 / self.resistance

    @property
    def force_per_volt(self) -> float:
        """Stall force or torque at the output per volt, K gear / R [N/V or N m/V]."""
        return self.constant * self.gear / self.resistance


def motor(parameters: Parameters, joint: str) -> Motor:
    """The motor of `joint`: K = U / (v0 gear) and R = K U gear / F0 from no-load speed v0 and stall force F0 at U."""
    p = {name.removeprefix(f"{joint}."): value for name, value in parameters.values.items()}
    if joint == "shoulder":
        gear, stall = p["gear_ratio"], p["stall_torque"]
    else:
        gear, stall = 2 * np.pi * p["gear_ratio"] / p["lead"], p["stall_force"]
    constant = p["rated_voltage"] / (p["no_load_speed"] * gear)
    return Motor(constant, constant * p["rated_voltage"] * gear / stall, gear, p["rotor_inertia"])


def check_rotor(parameters: Parameters, joint: str) -> None:
    """Raises InputError if the rotor of `joint` is too light for the simulation's step."""
    constants = motor(parameters, joint)
    mass, lag = constants.reflected_inertia, constants.inertia * constants.resistance / constants.constant**2
    unit = "kg m²" if joint == "shoulder" else "kg"
    if mass < LIGHTEST[joint] or lag < QUICKEST:
        raise InputError(
            f"the {joint}'s rotor weighs {mass:.2g} {unit} at the output, time constant {1e3 * lag:.2g} ms; "
            f"give rotor_inertia and gear_ratio for at least {LIGHTEST[joint]:g} {unit} and {1e3 * QUICKEST:g} ms"
        )


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
    coulomb, tilt, *rest = (
        values[f"{joint}.{name}"] for name in ("coulomb", "asymmetry", "stribeck", "stribeck_speed", "load_friction")
    )
    return DryFriction(coulomb * (1.0 + tilt), coulomb * (1.0 - tilt), *rest)


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

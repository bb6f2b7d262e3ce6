"""Motor constants of the compiled `<dcmotor>` from datasheet numbers."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
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
    one = motor(parameters, joint)
    mass, lag = one.reflected_inertia, one.inertia * one.resistance / one.constant**2
    unit = "kg m²" if joint == "shoulder" else "kg"
    if mass < LIGHTEST[joint] or lag < QUICKEST:
        raise InputError(
            f"the {joint}'s rotor weighs {mass:.2g} {unit} at the output, time constant {1e3 * lag:.2g} ms; "
            f"give rotor_inertia and gear_ratio for at least {LIGHTEST[joint]:g} {unit} and {1e3 * QUICKEST:g} ms"
        )

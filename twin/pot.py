"""Joint angle to measured angle: the potentiometer's noise and its ADC."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin.parameters import Parameters


@dataclass(frozen=True)
class Potentiometer:
    """White Gaussian noise of `noise` [rad], then rounding to one of 2^bits codes over `span` [rad] about angle 0.

    It sits on the joint's axis and reads the angle between the links, so backlash is on its input side: it sees the
    link stand still while the actuator crosses the play. `noise` 0 and `bits` None switch the two parts off.
    """

    noise: float
    span: float
    bits: int | None

    @property
    def step(self) -> float:
        """One ADC code [rad], 0 without ADC."""
        return 0.0 if self.bits is None else self.span / 2**self.bits

    def read(self, angle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Measured angle (N,) [rad] of true `angle` (N,) [rad]."""
        reading = angle + self.noise * rng.standard_normal(len(angle))
        if self.bits is None:
            return reading
        half = 2 ** (self.bits - 1)
        return np.clip(np.round(reading / self.step), -half, half - 1) * self.step


def potentiometer(parameters: Parameters, without: Collection[str] = ()) -> Potentiometer:
    """The potentiometer of every joint, with noise and ADC where they are not switched off."""
    bits = None if "adc" in without else round(parameters["adc_bits"])
    return Potentiometer(0.0 if "noise" in without else parameters["pot_noise"], parameters["pot_range"], bits)

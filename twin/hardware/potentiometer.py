"""From joint angle to measured angle: the potentiometer's nonlinearity and noise, its ADC, and lost samples."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin.parameters import Parameters

SIDES = ("link", "drive")  # of the backlash, at which a potentiometer may sit
WAVES = 3  # of the deviation from a straight line, over the electrical angle


@dataclass(frozen=True)
class Potentiometer:
    """A reading of the joint's angle with nonlinearity, noise, rounding, sampling jitter and lost samples.

    An angle a reads as a + nonlinearity sin(wave a) [rad]; then white Gaussian noise of `noise` [rad] is added, and the
    value is rounded to one of 2^bits codes over `span` [rad] about angle 0. `scale` [V/rad] belongs to the
    potentiometer. The time error of a sample is `jitter` [s] (standard deviation, at most half a sampling interval).
    One of 1 / dropouts samples is lost, and the log repeats the previous one. `noise` 0 and `bits` None switch noise
    and ADC off.
    """

    noise: float
    span: float
    bits: int | None
    nonlinearity: float = 0.0
    scale: float = 1.0
    jitter: float = 0.0
    dropouts: float = 0.0

    @property
    def wave(self) -> float:
        """Angular frequency of the nonlinearity [rad/rad]."""
        return 2.0 * np.pi * WAVES / self.span

    @property
    def step(self) -> float:
        """One ADC code [rad], 0 without ADC."""
        return 0.0 if self.bits is None else self.span / 2**self.bits

    def read(self, angle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Logged reading (N,) [rad] of `angle` (N,) [rad], which already includes nonlinearity and jitter."""
        noise, lost_samples = rng.standard_normal(len(angle)), rng.random(len(angle)) < self.dropouts
        reading = angle + self.noise * noise
        if self.bits is not None:
            half = 2 ** (self.bits - 1)
            reading = np.clip(np.round(reading / self.step), -half, half - 1) * self.step
        lost_samples[0] = False
        return reading[np.maximum.accumulate(np.where(lost_samples, 0, np.arange(len(angle))))]

    def times(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Time errors (N,) [s] of N samples relative to k Ts."""
        errors = np.clip(self.jitter * rng.standard_normal(N), -0.5 * Ts, 0.5 * Ts)
        errors[0] = max(errors[0], 0.0)
        return errors


def potentiometer(parameters: Parameters, without: Collection[str] = ()) -> Potentiometer:
    """The potentiometer of every joint, with the parts that are not switched off."""
    p = parameters.switched_off(without)
    return Potentiometer(
        p["pot_noise"],
        p["pot_range"],
        None if np.isinf(p["adc_bits"]) else round(p["adc_bits"]),
        p["pot_linearity"] * p["pot_range"],
        p["pot_supply"] / p["pot_range"],
        p["sample_jitter"],
        p["dropout_rate"],
    )

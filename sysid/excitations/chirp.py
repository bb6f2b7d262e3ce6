"""Chirp: a sine with a frequency from f_min to f_max."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.excitations._settings import Paces, check, check_band, check_from_zero, check_name, samples


@checked(late=True)
@dataclass(frozen=True)
class Chirp:
    """Sine of `amplitude` from f_min to f_max [Hz] within `period` [s]; a period of 0 is the whole record.

    `spacing` "linear": the frequency grows linearly in time, with constant power density over the band. "log": it grows
    exponentially, with equal time for every octave. `repeat` "restart" starts again at f_min after each period; "back"
    returns to f_min within the period along the same frequencies. The signal starts at its peak and its mean over a
    period is removed, so that an integrating plant stays near its start. It has one amplitude and one frequency at a
    time, so static nonlinearity and dynamics are hard to separate; use `Multisine` or `Aprbs` for that. `rng` is not
    used; the signal is the same for every seed.
    """

    amplitude: float = 12.0
    f_min: float = 0.05
    f_max: float = 2.0
    period: float = 0.0
    spacing: str = "linear"
    repeat: str = "restart"
    offset: float = 0.0

    seeded: ClassVar[bool] = False
    paces: ClassVar[Paces] = {
        "fast": {"f_min": 0.2, "f_max": 3.0, "spacing": "log"},
        "slow": {"f_min": 0.05, "f_max": 1.0, "spacing": "log"},
    }
    travel_less: ClassVar[tuple[str, ...]] = ("amplitude",)
    travel_more: ClassVar[tuple[str, ...]] = ()
    least_samples: ClassVar[Mapping[str, int]] = {}
    centred: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        positive = {"amplitude": self.amplitude, "f_min": self.f_min, "f_max": self.f_max}
        check("a chirp", positive, {"offset": self.offset})
        check_from_zero("a chirp", {"period": self.period})
        check_name("a chirp", "spacing", self.spacing, ("linear", "log"))
        check_name("a chirp", "repeat", self.repeat, ("restart", "back"))
        if not self.f_min < self.f_max:
            raise InputError(f"a chirp from {self.f_min:g} to {self.f_max:g} Hz has no band; give f_min below f_max")

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with 90 % of the power."""
        return self.f_min, self.f_max

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; raises InputError if Ts or the record does not suit the band."""
        check_band("a chirp", self.f_min, self.f_max, Ts)
        P = samples("a chirp", "period", self.period, Ts) if self.period else N
        if self.f_min * P * Ts < 1:
            raise InputError(
                f"one period of the chirp is {P * Ts:g} s, less than one cycle of f_min {self.f_min:g} Hz; give a "
                f"longer period or record, or a higher f_min"
            )
        t = np.arange(P) * Ts
        u = np.cos(2 * np.pi * (self._back(t, P * Ts) if self.repeat == "back" else self._cycles(t, P * Ts)))
        u -= u.mean()
        return self.offset + self.amplitude * (u / np.abs(u).max())[np.arange(N) % P]

    def _cycles(self, t: np.ndarray, length: float) -> np.ndarray:
        """Cycles since the start at times t (P,) [s], the integral of the frequency, for a rise in `length` [s]."""
        if self.spacing == "linear":
            return self.f_min * t + (self.f_max - self.f_min) * t**2 / (2 * length)
        rate = np.log(self.f_max / self.f_min) / length
        return self.f_min * np.expm1(rate * t) / rate

    def _back(self, t: np.ndarray, length: float) -> np.ndarray:
        """The same, up in half of `length` and down in the mirrored other half."""
        half = length / 2
        up = self._cycles(np.minimum(t, half), half)
        half_cycles = self._cycles(np.array([half]), half)[0]
        return np.where(t <= half, up, 2 * half_cycles - self._cycles(np.maximum(length - t, 0.0), half))

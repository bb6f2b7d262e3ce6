"""Amplitude-modulated pseudo-random binary signal: random levels held for random times."""

from dataclasses import dataclass

import numpy as np

from sysid.errors import InputError


@dataclass(frozen=True)
class Aprbs:
    """Levels uniform in [-amplitude, amplitude], each held for a time uniform in [hold_min, hold_max] [s].

    Random levels show a static input map all along its range, random holds the dynamics (Nelles, Nonlinear System
    Identification, 2nd ed. 2020, section 17.7). An integrating plant drifts under it: expect time at the ends.
    """

    amplitude: float = 12.0
    hold_min: float = 0.5
    hold_max: float = 5.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and 0 < self.hold_min <= self.hold_max < np.inf):
            raise InputError(
                f"an aprbs needs a finite amplitude and 0 < hold_min <= hold_max, got amplitude {self.amplitude}, "
                f"hold_min {self.hold_min} s, hold_max {self.hold_max} s; give holds in that order"
            )

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude], drawn from `rng`."""
        u = np.empty(N)
        k = 0
        while k < N:
            hold = max(1, round(rng.uniform(self.hold_min, self.hold_max) / Ts))
            u[k : k + hold] = rng.uniform(-self.amplitude, self.amplitude)
            k += hold
        return u

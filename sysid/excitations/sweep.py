"""Square sweep: drive from end to end and rest there, the experiment of the paper."""

from dataclasses import dataclass

import numpy as np

from sysid.errors import InputError


@dataclass(frozen=True)
class Sweep:
    """Square wave +amplitude, -amplitude, ... of `half_period` [s] a level.

    An integrating plant with end stops then travels from its minimum to its maximum and rests at each end for what is
    left of the half period (Guni and Irawan 2016, section IV.A). It shows the ends and the speed at one voltage, and
    nothing of what happens between voltage levels: use `Aprbs` where the input map matters.
    """

    amplitude: float = 12.0
    half_period: float = 8.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and np.isfinite(self.half_period) and self.half_period > 0):
            raise InputError(
                f"a sweep needs a finite amplitude and a half period above 0 s, got {self.amplitude} and "
                f"{self.half_period} s; give both as positive numbers"
            )

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; `rng` is not used, the sweep has no random part."""
        # Half a sample is added so that rounding of k Ts / half_period cannot move an edge.
        phase = np.floor((np.arange(N) + 0.5) * Ts / self.half_period).astype(int)
        return np.where(phase % 2 == 0, self.amplitude, -self.amplitude)

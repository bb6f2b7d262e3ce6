"""Square sweep: drive from end to end and rest there, the experiment of the paper."""

from dataclasses import dataclass

import numpy as np

from sysid.errors import InputError


@dataclass(frozen=True)
class Sweep:
    """Square wave +amplitude, -amplitude, ... of `half_period` [s] a level, each longer or shorter by up to `jitter`.

    An integrating plant with end stops then travels from its minimum to its maximum and rests at each end for what is
    left of the half period (Guni and Irawan 2016, section IV.A). It shows the ends and the speed at one voltage, and
    nothing of what happens between voltage levels: use `Aprbs` where the input map matters. Without jitter (a share of
    the half period, drawn uniformly) the record is periodic, and a validation part only repeats what was fitted.
    """

    amplitude: float = 12.0
    half_period: float = 8.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and np.isfinite(self.half_period) and self.half_period > 0):
            raise InputError(
                f"a sweep needs a finite amplitude and a half period above 0 s, got {self.amplitude} and "
                f"{self.half_period} s; give both as positive numbers"
            )
        if not 0.0 <= self.jitter < 1.0:
            raise InputError(f"jitter is {self.jitter}; give a share of the half period from 0 to below 1")

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; `rng` draws the jitter alone."""
        t = (np.arange(N) + 0.5) * Ts  # half a sample on, so that rounding cannot move an edge
        if self.jitter == 0.0:
            phase = np.floor(t / self.half_period).astype(int)
        else:
            count = int(np.ceil(N * Ts / (self.half_period * (1.0 - self.jitter)))) + 1
            edges = np.cumsum(self.half_period * (1.0 + self.jitter * rng.uniform(-1.0, 1.0, count)))
            phase = np.searchsorted(edges, t)
        return np.where(phase % 2 == 0, self.amplitude, -self.amplitude)

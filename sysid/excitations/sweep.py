"""Square sweep: drive from end to end and rest there; the experiment of the paper."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.limits import check_steps
from sysid.excitations._settings import Paces, check, check_from_zero


@checked(late=True)
@dataclass(frozen=True)
class Sweep:
    """Square wave +amplitude, -amplitude, ... with levels of `half_period` [s], each varied by up to `jitter`.

    An integrating plant with end stops travels from its minimum to its maximum and rests at each end for the remaining
    half period (Guni and Irawan 2016, section IV.A). The record shows the ends and the speed at one voltage, but not
    the input map between the levels; use `Aprbs` for that. Without jitter (a share of the half period, drawn
    uniformly) the record is periodic, and the validation data only repeat the estimation data. The first level lasts
    `first` of a half period: 0.5 centres the travel of an integrating plant on its start. `shrink` draws each level
    uniformly from (1 - shrink) to 1 times the amplitude: the record then shows speeds at many voltages, and so
    friction, while the plant still reaches its ends, which removes drift.
    """

    amplitude: float = 12.0
    half_period: float = 8.0
    jitter: float = 0.0
    offset: float = 0.0
    first: float = 1.0
    shrink: float = 0.0

    seeded: ClassVar[bool] = False
    paces: ClassVar[Paces] = {"fast": {"half_period": 2.0}, "slow": {"half_period": 8.0}}
    travel_less: ClassVar[tuple[str, ...]] = ("amplitude", "half_period")
    travel_more: ClassVar[tuple[str, ...]] = ("half_period",)
    least_samples: ClassVar[Mapping[str, int]] = {"half_period": 1}
    centred: ClassVar[Mapping[str, float]] = {"first": 0.5}

    def __post_init__(self) -> None:
        positive = {"amplitude": self.amplitude, "half period": self.half_period, "first": self.first}
        check("a sweep", positive, {"offset": self.offset})
        check_from_zero("a sweep", {"jitter": self.jitter, "shrink": self.shrink})
        for name, share in (("jitter", self.jitter), ("shrink", self.shrink)):
            if share >= 1.0:
                raise InputError(f"{name} is {share}; give a share from 0 to below 1")
        if self.first > 1.0:
            raise InputError(f"first is {self.first}; give a share of the half period above 0 and up to 1")

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with 90 % of the power: the first and third harmonic of a square wave, 81 + 9 %."""
        return 0.0, 3.5 / (2 * self.half_period * (1 - self.jitter))

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; `rng` draws jitter and shrinking."""
        check_steps("a record in half periods", N * Ts / self.half_period)
        t = (np.arange(N) + 0.5) * Ts  # half a sample on, so that rounding cannot move an edge
        if self.jitter == 0.0:
            phase = np.floor((t + (1.0 - self.first) * self.half_period) / self.half_period).astype(int)
        else:
            count = int(np.ceil(N * Ts / (self.half_period * (1.0 - self.jitter)))) + 2
            holds = self.half_period * (1.0 + self.jitter * rng.uniform(-1.0, 1.0, count))
            holds[0] *= self.first
            phase = np.searchsorted(np.cumsum(holds), t)
        levels = np.full(phase[-1] + 1, self.amplitude)
        if self.shrink:
            levels *= 1.0 - self.shrink * rng.random(len(levels))
        return self.offset + np.where(phase % 2 == 0, 1.0, -1.0) * levels[phase]

"""Staircase: held levels up and down over the whole range."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.excitations._settings import Paces, check, check_name, check_whole, samples


@checked(late=True)
@dataclass(frozen=True)
class Staircase:
    """2 `steps` + 1 equally spaced levels from -amplitude to amplitude, each held for `hold` [s], repeatedly.

    `order` "stairs" goes from zero to the top, down to the bottom and back. If the holds are longer than the settling
    time, the ends of the holds give the static map upwards and downwards, and so its hysteresis. "alternating" takes
    each level and its opposite in turn (+1, -1, +2, -2, ... back to +1, -1 steps): an integrating plant returns after
    every pair and shows its speed at each level. Not for dynamics faster than the hold. `rng` is not used; the signal
    is the same for every seed.
    """

    amplitude: float = 12.0
    steps: int = 6
    hold: float = 2.0
    order: str = "stairs"
    offset: float = 0.0

    seeded: ClassVar[bool] = False
    paces: ClassVar[Paces] = {"fast": {"hold": 0.3}, "slow": {"hold": 1.0}}
    travel_less: ClassVar[tuple[str, ...]] = ("amplitude", "hold")
    travel_more: ClassVar[tuple[str, ...]] = ("hold",)
    least_samples: ClassVar[Mapping[str, int]] = {"hold": 1}
    centred: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        check("a staircase", {"amplitude": self.amplitude, "hold": self.hold}, {"offset": self.offset})
        check_whole("a staircase", "steps", self.steps, 1, 1000)
        check_name("a staircase", "order", self.order, ("stairs", "alternating"))

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with 90 % of the power: the first two lobes of one hold."""
        return 0.0, 2.0 / self.hold

    @property
    def sequence(self) -> np.ndarray:
        """Levels of one round as shares of the amplitude, from -1 to 1: 4 steps (stairs), else 4 steps - 2."""
        up = np.arange(1, self.steps + 1) / self.steps
        if self.order == "stairs":
            climb = np.concatenate([up, up[-2::-1]])
            return np.concatenate([[0.0], climb, [0.0], -climb])
        sizes = np.concatenate([up, up[-2::-1]])
        return np.stack([sizes, -sizes], axis=1).ravel()

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]."""
        hold = samples("a staircase", "hold", self.hold, Ts)
        sequence = self.sequence
        return self.offset + self.amplitude * sequence[(np.arange(N) // hold) % len(sequence)]

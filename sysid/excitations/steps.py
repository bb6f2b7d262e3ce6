"""Steps from rest: up, back to zero, down, back to zero."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.excitations._settings import Paces, check, check_from_zero, check_name, samples, within_reach


@checked(late=True)
@dataclass(frozen=True)
class Steps:
    """Rest of `rest` [s], a level held for `hold` [s], rest again, and so on; rest is at `offset`.

    `levels` "fixed": +amplitude and -amplitude in turn. "random": uniform in [-amplitude, amplitude]; with a `reach`
    [unit of amplitude times s] a level that would take the running integral of u - offset beyond the reach changes its
    sign or is shortened, so that an integrating plant stays near its start (0: no limit). The part of a level up to
    `dead` [unit of amplitude] is not integrated. Each step shows a step response: rise, settling and stiction. Half of
    the record is at rest; use `Aprbs` or `Multisine` to fit a model.
    """

    amplitude: float = 12.0
    hold: float = 2.0
    rest: float = 2.0
    levels: str = "random"
    offset: float = 0.0
    reach: float = 0.0
    dead: float = 0.0

    seeded: ClassVar[bool] = True
    paces: ClassVar[Paces] = {"fast": {"hold": 0.8, "rest": 0.5}, "slow": {"hold": 3.0, "rest": 2.0}}
    travel_more: ClassVar[tuple[str, ...]] = ("hold",)
    least_samples: ClassVar[Mapping[str, int]] = {"hold": 1}
    centred: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        check("steps", {"amplitude": self.amplitude, "hold": self.hold, "rest": self.rest}, {"offset": self.offset})
        check_from_zero("steps", {"reach": self.reach, "dead": self.dead})
        check_name("steps", "levels", self.levels, ("random", "fixed"))

    @property
    def travel_less(self) -> tuple[str, ...]:
        """Settings that reduce the travel; a reach changes only the sign of random levels."""
        return ("amplitude", "hold") if self.levels == "fixed" else ("reach", "amplitude", "hold")

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with 90 % of the power: the first two lobes of one hold."""
        return 0.0, 2.0 / self.hold

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; `rng` draws only random levels."""
        hold, rest = samples("steps", "hold", self.hold, Ts), samples("steps", "rest", self.rest, Ts)
        u = np.full(N, float(self.offset))
        total = 0.0
        for k, start in enumerate(range(rest, N, hold + rest)):
            fixed = self.levels == "fixed"
            level = self.amplitude * ((-1.0) ** k if fixed else rng.uniform(-1.0, 1.0))
            area = np.sign(level) * max(abs(level) - self.dead, 0.0) * hold * Ts
            sign, share = within_reach(total, area, self.reach) if self.reach > 0 and not fixed else (1.0, 1.0)
            length = max(1, int(share * hold))
            total += sign * area * length / hold
            u[start : start + length] += sign * level
        return u

"""Amplitude-modulated pseudo-random binary signal: random levels held for random times."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.limits import MOST, check_steps
from sysid.excitations._settings import Paces, check, check_from_zero, within_reach


@checked(late=True)
@dataclass(frozen=True)
class Aprbs:
    """Levels uniform in [-amplitude, amplitude], each held for a time uniform in [hold_min, hold_max] [s].

    Random levels excite a static input map over its whole range; random holds excite the dynamics (Nelles, Nonlinear
    System Identification, 2nd ed. 2020, section 17.7). An integrating plant drifts and may rest at its ends; a `reach`
    [unit of amplitude times s] limits this. A level that would take the running integral of u - offset beyond the reach
    changes its sign, and is shortened if that does not suffice; the size of the levels does not change. The part of a
    level up to `dead` [unit of amplitude] does not move a plant with dry friction and is not integrated. A reach of 0
    sets no limit.
    """

    amplitude: float = 12.0
    hold_min: float = 0.5
    hold_max: float = 5.0
    offset: float = 0.0
    reach: float = 0.0
    dead: float = 0.0

    seeded: ClassVar[bool] = True
    paces: ClassVar[Paces] = {
        "fast": {"hold_min": 0.2, "hold_max": 1.5},
        "slow": {"hold_min": 0.5, "hold_max": 5.0},
    }
    travel_less: ClassVar[tuple[str, ...]] = ("reach", "amplitude")
    travel_more: ClassVar[tuple[str, ...]] = ("hold_min", "hold_max")
    least_samples: ClassVar[Mapping[str, int]] = {}
    centred: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        positive = {"amplitude": self.amplitude, "hold_min": self.hold_min, "hold_max": self.hold_max}
        check("an aprbs", positive, {"offset": self.offset})
        check_from_zero("an aprbs", {"reach": self.reach, "dead": self.dead})
        if self.hold_min > self.hold_max:
            raise InputError(
                f"an aprbs needs 0 < hold_min <= hold_max; found hold_min {self.hold_min} s, hold_max {self.hold_max} s"
                "; give holds in that order"
            )

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with 90 % of the power: up to twice the mean rate of levels.

        The mean share of power below f of independent levels with holds T is 1 - 1 / (pi^2 f E[T]), here 95 %.
        """
        return 0.0, 4.0 / (self.hold_min + self.hold_max)

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude], drawn from `rng`."""
        check_steps("hold_max of an aprbs", self.hold_max / Ts, MOST)
        u = np.empty(N)
        k, total = 0, 0.0
        while k < N:
            hold = max(1, round(rng.uniform(self.hold_min, self.hold_max) / Ts))
            level = rng.uniform(-self.amplitude, self.amplitude)
            moving = np.sign(level) * max(abs(level) - self.dead, 0.0) * Ts
            if self.reach > 0:
                sign, share = within_reach(total, moving * hold, self.reach)
                level, moving, hold = sign * level, sign * moving, max(1, int(share * hold))
                total += moving * hold
            u[k : k + hold] = self.offset + level
            k += hold
        return u

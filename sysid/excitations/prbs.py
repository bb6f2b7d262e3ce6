"""Pseudo-random binary sequence from a maximum-length shift register."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.excitations._settings import Paces, check, check_name, check_whole, half_way, samples


@checked(late=True)
@dataclass(frozen=True)
class Prbs:
    """+-amplitude, clocked every `hold` [s] by a shift register of `nbits`, with period (2^nbits - 1) hold.

    Over whole periods its autocorrelation is amplitude^2 at lag 0 and -amplitude^2 / (2^nbits - 1) at every other
    clock (Golomb, Shift Register Sequences, 1967), so it is nearly white up to the clock rate. `repeat` "inverse"
    inverts every second clock: twice the period, mean zero, and only odd harmonics, so that even harmonics show even
    nonlinearities (Godfrey, Perturbation Signals for System Identification, 1993, section 1.3). Two levels cannot
    identify a static map; use `Aprbs` or `Multisine` for that. `rng` draws the sign and the start, among those with a
    running sum midway between its extremes, so that an integrating plant stays centred on its start.
    """

    amplitude: float = 12.0
    nbits: int = 7
    hold: float = 0.3
    repeat: str = "plain"
    offset: float = 0.0

    seeded: ClassVar[bool] = True
    paces: ClassVar[Paces] = {"fast": {"hold": 0.1, "nbits": 8}, "slow": {"hold": 0.3, "nbits": 8}}
    travel_less: ClassVar[tuple[str, ...]] = ("amplitude", "hold")
    travel_more: ClassVar[tuple[str, ...]] = ("hold",)
    least_samples: ClassVar[Mapping[str, int]] = {"hold": 1}
    centred: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        check("a prbs", {"amplitude": self.amplitude, "hold": self.hold}, {"offset": self.offset})
        check_whole("a prbs", "nbits", self.nbits, 2, 20)
        check_name("a prbs", "repeat", self.repeat, ("plain", "inverse"))

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with 90 % of the power: the main lobe of one clock."""
        return 0.0, 1.0 / self.hold

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; a record shorter than a period is its start."""
        from scipy.signal import max_len_seq  # half a second, which no help text waits for

        hold = samples("a prbs", "hold", self.hold, Ts)
        bits = 2.0 * max_len_seq(self.nbits)[0] - 1.0
        if self.repeat == "inverse":
            bits = np.concatenate([bits, bits]) * (-1.0) ** np.arange(2 * len(bits))
        bits = rng.choice([-1.0, 1.0]) * np.roll(bits, -rng.choice(half_way(bits)))
        return self.offset + self.amplitude * bits[(np.arange(N) // hold) % len(bits)]

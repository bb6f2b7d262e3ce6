"""Multisine: a sum of sines on chosen lines with phases for a low crest factor."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.excitations._settings import Paces, check, check_band, check_name, half_way, samples

GRIDS = ("full", "odd", "odd_odd", "random_odd")
PHASES = ("optimised", "schroeder", "random")
GROUP = 4  # odd lines per detection line of a random odd grid
NORMS = (4, 8, 16, 32, 64, 128, 256)


@checked(late=True)
@dataclass(frozen=True)
class Multisine:
    """Sines of equal power at multiples of 1 / `period` from f_min to f_max [Hz], scaled to a peak of `amplitude`.

    `grid` chooses the multiples (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed.
    2012, chapters 4 and 5). "full": all. "odd": 1, 3, 5, ...; even nonlinearities appear between the lines. "odd_odd":
    1, 5, 9, ...; odd nonlinearities also appear, on the odd lines left out. "random_odd": odd, with one of every four
    neighbours left out at random, which shows both and uses three quarters of the odd lines. `phases` "optimised"
    gives the highest power for the peak, "schroeder" is a closed formula, "random" is the input assumed in the theory
    of the best linear approximation. Start phases, random phases and grids come from `rng`: another seed is an
    independent realisation with the same power on the same lines (except for a random grid). Channels of several
    inputs that draw from their own generators are uncorrelated on average over realisations, not within one.

    The record must have at least one period; a whole number of periods gives a spectrum without leakage. The signal
    starts where its running sum is midway between its extremes, so that an integrating plant stays centred on its
    start.
    """

    amplitude: float = 12.0
    f_min: float = 0.05
    f_max: float = 2.0
    period: float = 20.0
    grid: str = "full"
    phases: str = "optimised"
    offset: float = 0.0

    seeded: ClassVar[bool] = True
    paces: ClassVar[Paces] = {
        "fast": {"f_min": 0.2, "f_max": 2.0, "period": 10.0},
        "slow": {"f_min": 0.04, "f_max": 0.4, "period": 25.0},
    }
    travel_less: ClassVar[tuple[str, ...]] = ("amplitude",)
    travel_more: ClassVar[tuple[str, ...]] = ()
    least_samples: ClassVar[Mapping[str, int]] = {}
    centred: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        positive = {"amplitude": self.amplitude, "f_min": self.f_min, "f_max": self.f_max, "period": self.period}
        check("a multisine", positive, {"offset": self.offset})
        check_name("a multisine", "grid", self.grid, GRIDS)
        check_name("a multisine", "phases", self.phases, PHASES)
        if not self.f_min <= self.f_max:
            raise InputError(
                f"a multisine from {self.f_min:g} to {self.f_max:g} Hz has no band; give f_min up to f_max"
            )

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with all of the power."""
        return self.f_min, self.f_max

    @checked
    def lines(self, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Excited multiples (F,) of 1 / period; `rng` chooses the lines that a random odd grid leaves out."""
        check_band("a multisine", self.f_min, self.f_max, Ts)
        length = samples("a multisine", "period", self.period, Ts) * Ts  # [s] as it is sampled
        slack = 1e-9  # a band edge that lies on a line is in
        first, last = int(np.ceil(self.f_min * length - slack)), int(np.floor(self.f_max * length + slack))
        k = np.arange(max(first, 1), last + 1)
        if self.grid == "odd_odd":
            k = k[k % 4 == 1]
        elif self.grid != "full":
            k = k[k % 2 == 1]
        if self.grid == "random_odd":
            grouped = len(k) // GROUP * GROUP
            k = np.delete(k, np.arange(0, grouped, GROUP) + rng.integers(GROUP, size=grouped // GROUP))
        if len(k) == 0:
            raise InputError(
                f"a multisine of period {self.period:g} s has no line of the {self.grid} grid from {self.f_min:g} to "
                f"{self.f_max:g} Hz; give a longer period or a wider band"
            )
        return k

    @checked
    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) [unit of amplitude]; raises InputError if Ts or the record does not suit the band."""
        lines = self.lines(Ts, rng)
        P = samples("a multisine", "period", self.period, Ts)
        if N < P:
            raise InputError(
                f"a record of {N * Ts:g} s is shorter than one period of the multisine, {self.period:g} s; give a "
                f"longer record or a shorter period"
            )
        if self.phases == "schroeder":
            phases = schroeder(len(lines))
        else:
            phases = rng.uniform(0.0, 2 * np.pi, len(lines))
            if self.phases == "optimised":
                phases = flattest(lines, phases, P)
        u = synthesis(lines, phases, P)
        u = np.roll(u / np.abs(u).max(), -half_way(u)[0])
        return self.offset + self.amplitude * u[np.arange(N) % P]


def synthesis(lines: np.ndarray, phases: np.ndarray, P: int) -> np.ndarray:
    """Sum of cos(2 pi k n / P + phase) over lines k (F,), at n = 0 .. P - 1: u (P,)."""
    spectrum = np.zeros(P // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(1j * phases) * P / 2
    return np.fft.irfft(spectrum, P)


def crest_factor(u: np.ndarray) -> float:
    """Peak over root mean square of u (N,): 1 for a square wave, 1.414 for a sine."""
    return float(np.abs(u).max() / np.sqrt(np.mean(u**2)))


def schroeder(F: int) -> np.ndarray:
    """Phases -pi k (k - 1) / F (F,) [rad] of a flat multisine (Schroeder, IEEE Trans. Inf. Theory 16(1), 1970)."""
    k = np.arange(1, F + 1)
    return -np.pi * k * (k - 1) / F


def flattest(lines: np.ndarray, phases: np.ndarray, P: int) -> np.ndarray:
    """Phases (F,) [rad] with a lower peak, optimised from `phases` (F,).

    Minimises the p-norm of u over growing p, which tends to the peak (Guillaume, Schoukens, Pintelon and Kollar, IEEE
    Trans. Instrum. Meas. 40(6), 1991; by quasi-Newton steps instead of theirs). The peak is that of the levels at the
    samples, because these are held.
    """
    from scipy.optimize import minimize  # a fifth of a second, which no help text waits for

    best = phases
    with one_blas_thread():  # the same digits at any thread count
        for p in NORMS:
            phases = minimize(_log_norm, phases, (lines, P, p), jac=True, method="L-BFGS-B", options={"maxiter": 100}).x
            best = min(best, phases, key=lambda phi: crest_factor(synthesis(lines, phi, P)))
    return best


def _log_norm(phases: np.ndarray, lines: np.ndarray, P: int, p: int) -> tuple[float, np.ndarray]:
    """log ||u||_p with u of unit root mean square, and its gradient (F,) with respect to the phases."""
    rms = np.sqrt(len(lines) / 2)
    u = synthesis(lines, phases, P) / rms
    peak = np.abs(u).max()
    scaled = u / peak  # powers up to 256 of this cannot overflow
    powers = np.abs(scaled) ** p
    total = powers.sum()
    # d log||u||_p = sum_n |u|^(p-2) u du / sum_n |u|^p, and du = -sin(2 pi k n / P + phase_k) / rms.
    weights = np.fft.rfft(np.abs(scaled) ** (p - 2) * scaled)[lines]
    gradient = -np.imag(np.exp(1j * phases) * np.conj(weights)) / (rms * peak * total)
    return float(np.log(peak) + np.log(total / P) / p), gradient

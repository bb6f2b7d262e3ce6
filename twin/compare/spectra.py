"""Frequency responses from input to angle with their confidence, by the same estimator for a log and for the twin."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import csd, welch
from scipy.stats import f as fisher

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.diagnosis import bla

LEVEL = 0.95
_SEGMENTS = 8  # of a record without a period, before they overlap
_OVERLAP = 1 / 6  # correlation of Hann windows that overlap by half (Welch, IEEE Trans. Audio Electroacoust. 15, 1967)


@dataclass(frozen=True)
class Spectrum:
    """G (F,) [y/u] at `frequency` (F,) [Hz], and the radius (F,) around it that holds the truth with level `LEVEL`."""

    frequency: np.ndarray
    G: np.ndarray
    radius: np.ndarray
    method: str

    @property
    def magnitude(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """|G| with its lower and upper limit (F,)."""
        size = np.abs(self.G)
        return size, np.maximum(size - self.radius, 0.0), size + self.radius

    @property
    def phase(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Phase [rad], unwrapped, with its limits (F,); infinitely far where G may be zero."""
        turn = np.unwrap(np.angle(self.G))
        ratio = self.radius / np.maximum(np.abs(self.G), 1e-300)
        half = np.where(ratio < 1.0, np.arcsin(np.minimum(ratio, 1.0)), np.inf)
        return turn, turn - half, turn + half


def spectrum(u: np.ndarray, y: np.ndarray, Ts: float) -> Spectrum:
    """Best linear approximation of a periodic record, Welch's average of another; the mean and a trend are removed.

    The radius: of the best linear approximation from its total variance, a complex normal number's; of Welch's from
    the coherence (Bendat and Piersol, Random Data, 4th ed. 2010, section 9.2.4) with as many independent segments as
    overlapping Hann windows leave.
    """
    u, y = np.asarray(u, dtype=float).ravel(), np.asarray(y, dtype=float).ravel()
    try:
        found = bla.estimate(IOData(u, y, Ts))
    except InputError:
        return _welch(u, y, Ts)
    radius = np.sqrt(-np.log(1.0 - LEVEL) * found.total_variance)
    return Spectrum(found.frequency, found.G, radius, f"best linear approximation over {found.periods} periods")


def _welch(u: np.ndarray, y: np.ndarray, Ts: float) -> Spectrum:
    length = max(2 * (len(u) // (2 * _SEGMENTS)), 8)
    options = {"fs": 1.0 / Ts, "nperseg": min(length, len(u)), "detrend": "linear"}
    frequency, cross = csd(u, y, **options)
    power, out = welch(u, **options)[1], welch(y, **options)[1]
    used = power > 1e-6 * power.max()
    used[0] = used[-1] = False
    frequency, cross, power, out = frequency[used], cross[used], power[used], out[used]
    coherence = np.clip(np.abs(cross) ** 2 / np.maximum(power * out, 1e-300), 1e-12, 1.0)
    segments = 2 * len(u) // length - 1
    n = segments / (1.0 + 2.0 * _OVERLAP**2 * (segments - 1) / segments)
    limit = 2.0 / max(2.0 * n - 2.0, 1.0) * fisher.ppf(LEVEL, 2.0, max(2.0 * n - 2.0, 1.0))
    G = cross / power
    radius = np.abs(G) * np.sqrt(limit * (1.0 - coherence) / coherence)
    return Spectrum(frequency, G, radius, f"Welch's average of {segments} segments of {length * Ts:g} s")

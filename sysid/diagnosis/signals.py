"""Properties of a single signal: order of excitation, number of levels, rests at the extremes, converter step."""

from dataclasses import dataclass

import numpy as np

_ROWS = 20_000  # samples used for the order of excitation


def persistence(u: np.ndarray, highest: int = 50) -> int:
    """Order n of persistent excitation of u (N,): the most lags whose covariance has full rank, up to `highest`.

    The order is the rank of the lag matrix, so a sum of m sines has exactly 2 m (Ljung, System Identification,
    definition 13.2). A singular value below 1e-4 of the largest counts as zero.
    """
    x = np.asarray(u, dtype=float).ravel()[:_ROWS]
    x = x - x.mean()
    highest = min(highest, len(x) // 3)
    if highest < 1 or not x.any():
        return 0
    lags = np.lib.stride_tricks.sliding_window_view(x, highest)
    s = np.linalg.svd(np.linalg.qr(lags, mode="r"), compute_uv=False)
    return int(np.sum(s > 1e-4 * s[0]))


def levels(u: np.ndarray, tolerance: float = 1e-6) -> int:
    """Number of distinct values of u (N,); values within `tolerance` of its range count as one."""
    x = np.sort(np.asarray(u, dtype=float).ravel())
    span = float(x[-1] - x[0])
    return 1 if span == 0 else int(1 + np.sum(np.diff(x) > tolerance * span))


@dataclass(frozen=True)
class Rest:
    """Shares of samples within a band of the lowest and of the highest value, and the width of the band."""

    low: float
    high: float
    band: float


def rests(y: np.ndarray, noise: float = 0.0) -> Rest:
    """Rests at the extremes: samples within the band of an extreme whose neighbours are in the band too.

    The band is half a percent of the range, or six standard deviations of the noise if that is wider (the extreme of a
    noisy rest is three from its level), but at most a twentieth of the range.
    """
    y = np.asarray(y, dtype=float).ravel()
    band = min(max(0.005 * float(np.ptp(y)), 6.0 * noise), 0.05 * float(np.ptp(y)))

    def share(near: np.ndarray) -> float:
        return float(np.mean(near[1:-1] & near[:-2] & near[2:])) if len(near) > 2 else 0.0

    return Rest(share(y <= y.min() + band), share(y >= y.max() - band), band)


def sine_rest(share_of_range: float) -> float:
    """Share of time that a sine is within this share of its range of one extreme; up to this share is not a rest."""
    return float(np.arccos(np.clip(1.0 - 2.0 * share_of_range, -1.0, 1.0)) / np.pi)


def step(y: np.ndarray) -> float | None:
    """Converter step of y (N,), if its values are few and a regular step apart; otherwise None."""
    y = np.asarray(y, dtype=float).ravel()
    values = np.unique(y)
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * float(np.ptp(y))]
    if len(gaps) < 4 or len(values) > len(y) // 2:
        return None
    q = float(np.min(gaps))
    return q if np.median(np.abs(gaps / q - np.round(gaps / q))) < 0.05 and np.median(gaps) < 20 * q else None


def rise(b: np.ndarray, a: np.ndarray, longest: int) -> tuple[int | None, bool]:
    """Samples to 63 % of the final step response of B/A (with delay), and whether it settles within `longest`."""
    from scipy.signal import lfilter

    with np.errstate(over="ignore", invalid="ignore"):
        g = np.asarray(lfilter(b, a, np.ones(longest)))
    tail, before = g[-longest // 10 :], g[-longest // 5 : -longest // 10]
    if not np.all(np.isfinite(g)) or abs(tail.mean() - before.mean()) > 0.02 * float(np.ptp(g)) or tail.mean() == 0:
        return None, False
    return int(np.argmax(np.abs(g) >= (1 - np.exp(-1.0)) * abs(tail.mean()))), True


def swing(f: np.ndarray) -> float:
    """Samples in a period of the fastest oscillation of 1/F that rings (damping below 0.5); infinite if none does."""
    roots = np.roots(np.concatenate([[1.0], f])).astype(complex)
    s = np.log(roots[np.abs(roots) > 1e-3])
    ringing = s[(np.abs(s.imag) > 1e-6) & (-s.real < 0.5 * np.abs(s))]
    return float(2 * np.pi / np.max(np.abs(ringing.imag))) if len(ringing) else np.inf


def reaches(u: np.ndarray, frequency: float) -> bool:
    """Whether an input (N, nu) has a hundredth of its variance above this frequency [cycles/sample]."""
    x = u - u.mean(axis=0)
    power = np.abs(np.fft.rfft(x, axis=0)) ** 2
    above = np.fft.rfftfreq(len(x)) > frequency
    return bool(np.any(power[above].sum(axis=0) > 0.01 * power.sum(axis=0)))

"""The regimes of a record: each sample is at a reversal, at an end stop, at rest, slow or fast."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter
from scipy.stats import norm

from sysid.diagnosis.signals import rests

SPAN = 0.35  # [s] over which a slope is a speed
BEFORE, AFTER = 0.1, 0.4  # [s] around a reversal that belong to it
FAST = 0.5  # of the record's fastest motion: above it motion is fast
STILL = 0.03  # of the fastest motion, at least: below it the joint rests
LEAST_REST = 0.01  # share of the record at an extreme from which that is an end stop
_REACH, _LOST = 8, 0.01
NAMES = ("reversal", "end stop", "rest", "slow", "fast")
DEFINITIONS = {
    "reversal": f"from {BEFORE:g} s before to {AFTER:g} s after motion starts against the direction of the last motion",
    "end stop": "at rest at the lowest or highest angle of the record, if it rests there",
    "rest": f"slower than {100 * STILL:g} % of the fastest motion, or than what noise passes for",
    "slow": f"moving below {100 * FAST:g} % of the fastest motion",
    "fast": f"moving at {100 * FAST:g} % of the fastest motion or above",
}


@dataclass(frozen=True)
class Regime:
    """One regime: share of samples, RMS of the error in it [unit of y], and share of the sum of squared errors."""

    name: str
    share: float
    rms: float
    of_error: float


def noise_of(y: np.ndarray) -> float:
    """Standard deviation of white noise on y (N,), from second differences in the slower half of the record.

    Second differences of white noise have six times its variance. What is slow is seen from other samples than those of
    a second difference, so that it selects no noise; a hundredth that is largest is left out (lost samples), with what
    that takes from the variance of a normal number.
    """
    y = np.asarray(y, dtype=float).ravel()
    reach = min(_REACH, (len(y) - 3) // 2)
    middle = y[reach : len(y) - reach]
    second = np.abs(y[reach + 1 : len(y) - reach + 1] - 2.0 * middle + y[reach - 1 : len(y) - reach - 1])
    pace = np.abs(y[2 * reach :] - y[: len(y) - 2 * reach])
    slow = second[pace <= np.median(pace)]
    kept = slow[slow <= np.quantile(slow, 1.0 - _LOST)]
    z = float(norm.isf(_LOST / 2.0))
    left = 1.0 - 2.0 * z * float(norm.pdf(z)) / (1.0 - _LOST)
    return float(np.sqrt(np.mean(kept**2) / (6.0 * left)))


def speed_of(y: np.ndarray, Ts: float) -> tuple[np.ndarray, float]:
    """Smoothed speed (N,) [unit of y / s], and the standard deviation of the noise in it."""
    half = max(2, round(0.5 * SPAN / Ts))
    half = min(half, (len(y) - 1) // 2)
    speed = savgol_filter(np.asarray(y, dtype=float).ravel(), 2 * half + 1, 1, deriv=1, delta=Ts)
    k = np.arange(-half, half + 1)
    return speed, noise_of(y) / (Ts * float(np.sqrt(np.sum(k**2))))


def regimes(y: np.ndarray, Ts: float) -> dict[str, np.ndarray]:
    """Samples (N,) of each regime of the angle y (N,), by name; every sample is in exactly one.

    Earlier names of `NAMES` win: a reversal at an end stop is a reversal. See `DEFINITIONS`.
    """
    y = np.asarray(y, dtype=float).ravel()
    speed, uncertain = speed_of(y, Ts)
    fastest = float(np.quantile(np.abs(speed), 0.98))
    moves = np.abs(speed) > max(STILL * fastest, 3.0 * uncertain)
    at = {"reversal": _reversals(speed, moves, Ts), "end stop": ~moves & _at_ends(y)}
    at |= {"rest": ~moves, "slow": moves & (np.abs(speed) < FAST * fastest), "fast": moves}
    taken = np.zeros(len(y), dtype=bool)
    for name in NAMES:
        at[name] = at[name] & ~taken
        taken |= at[name]
    return {name: at[name] for name in NAMES}


def _at_ends(y: np.ndarray) -> np.ndarray:
    noise = noise_of(y)
    rest = rests(y, noise)
    low = (y <= y.min() + rest.band) if rest.low >= LEAST_REST else np.zeros(len(y), dtype=bool)
    high = (y >= y.max() - rest.band) if rest.high >= LEAST_REST else np.zeros(len(y), dtype=bool)
    return low | high


def _reversals(speed: np.ndarray, moves: np.ndarray, Ts: float) -> np.ndarray:
    """Samples around the first one that moves against the last motion."""
    near, moving = np.zeros(len(speed), dtype=bool), np.flatnonzero(moves)
    way = np.sign(speed[moving])
    for k in moving[1:][way[1:] != way[:-1]]:
        near[max(k - round(BEFORE / Ts), 0) : k + round(AFTER / Ts) + 1] = True
    return near


def by_regime(error: np.ndarray, at: Mapping[str, np.ndarray]) -> tuple[Regime, ...]:
    """Shares and RMS of error (N,) in each regime; RMS 0 where a regime has no samples."""
    total = float(np.sum(error**2)) or 1.0
    return tuple(
        Regime(
            name,
            float(np.mean(mask)),
            float(np.sqrt(np.mean(error[mask] ** 2))) if mask.any() else 0.0,
            float(np.sum(error[mask] ** 2)) / total,
        )
        for name, mask in at.items()
    )

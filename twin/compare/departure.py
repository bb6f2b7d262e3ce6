"""A departure in numbers: by regime of the motion, by frequency, and between two logs of one experiment."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import csd, detrend, savgol_filter, welch
from scipy.stats import f as fisher
from scipy.stats import norm

from sysid.base.errors import InputError
from sysid.base.rates import same_rate
from sysid.data.outliers import hampel, returning
from sysid.data.record import IOData
from sysid.diagnosis import bla
from sysid.diagnosis.signals import rests
from twin.compare.intervals import LEVEL, sandwich

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
    core = slow[slow <= np.quantile(slow, 1.0 - _LOST)]
    z = float(norm.isf(_LOST / 2.0))
    variance_share = 1.0 - 2.0 * z * float(norm.pdf(z)) / (1.0 - _LOST)
    return float(np.sqrt(np.mean(core**2) / (6.0 * variance_share)))


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
    samples = {"reversal": _reversals(speed, moves, Ts), "end stop": ~moves & _at_ends(y)}
    samples |= {"rest": ~moves, "slow": moves & (np.abs(speed) < FAST * fastest), "fast": moves}
    union = np.zeros(len(y), dtype=bool)
    for name in NAMES:
        samples[name] = samples[name] & ~union
        union |= samples[name]
    return {name: samples[name] for name in NAMES}


def _at_ends(y: np.ndarray) -> np.ndarray:
    noise = noise_of(y)
    rest = rests(y, noise)
    low = (y <= y.min() + rest.band) if rest.low >= LEAST_REST else np.zeros(len(y), dtype=bool)
    high = (y >= y.max() - rest.band) if rest.high >= LEAST_REST else np.zeros(len(y), dtype=bool)
    return low | high


def _reversals(speed: np.ndarray, moves: np.ndarray, Ts: float) -> np.ndarray:
    """Samples around the first one that moves against the last motion."""
    mask, moving = np.zeros(len(speed), dtype=bool), np.flatnonzero(moves)
    way = np.sign(speed[moving])
    for k in moving[1:][way[1:] != way[:-1]]:
        mask[max(k - round(BEFORE / Ts), 0) : k + round(AFTER / Ts) + 1] = True
    return mask


def by_regime(error: np.ndarray, samples: Mapping[str, np.ndarray]) -> tuple[Regime, ...]:
    """Shares and RMS of error (N,) in each regime; RMS 0 where a regime has no samples."""
    total = float(np.sum(error**2)) or 1.0
    return tuple(
        Regime(
            name,
            float(np.mean(mask)),
            float(np.sqrt(np.mean(error[mask] ** 2))) if mask.any() else 0.0,
            float(np.sum(error[mask] ** 2)) / total,
        )
        for name, mask in samples.items()
    )


@dataclass(frozen=True)
class Outlier:
    """A sample at `time` [s] that lies `size` [unit of y] from the line between its neighbours.

    On that line it would leave the sum of squared errors smaller by the share `of_error`.
    """

    time: float
    size: float
    of_error: float


def outliers(error: np.ndarray, noise: float, Ts: float, moves: np.ndarray) -> tuple[Outlier, ...]:
    """Samples of error (N,) that leave their neighbours by far more than noise does, and come back at once.

    No joint does this, and what the voltage makes of it is in both sides of the error. A converter's steps and a sensor
    that is not straight make the error rougher where the joint `moves` (N,) than where `noise` is measured.
    """
    bends = (error[1:-1] - 0.5 * (error[:-2] + error[2:]))[moves[1:-1]]  # of white noise: 1.5 times its variance
    rough = 1.4826 * float(np.median(np.abs(bends))) / np.sqrt(1.5) if len(bends) else 0.0
    mask = returning(error, hampel(error, floor=max(noise, rough)))
    places, sound = np.flatnonzero(mask), np.flatnonzero(~mask)
    sizes = error[places] - np.interp(places, sound, error[sound])
    shares = (error[places] ** 2 - (error[places] - sizes) ** 2) / np.sum(error**2)
    return tuple(map(Outlier, (places * Ts).tolist(), sizes.tolist(), shares.tolist()))


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
    def known(self) -> np.ndarray:
        """Where the response is surely not zero (F,)."""
        return np.asarray(self.radius < np.abs(self.G))

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


def has_power(u: np.ndarray) -> bool:
    """Whether an input (N,) has power at some frequency: it is more than a line, which is removed, and rounding."""
    return bool(np.std(detrend(u)) > 1e-9 * np.max(np.abs(u)))


def spectrum(u: np.ndarray, y: np.ndarray, Ts: float) -> Spectrum:
    """Best linear approximation of a periodic record, Welch's average of another; the mean and a trend are removed.

    The radius: of the best linear approximation from its total variance, a complex normal number's; of Welch's from
    the coherence (Bendat and Piersol, Random Data, 4th ed. 2010, section 9.2.4) with as many independent segments as
    overlapping Hann windows leave.
    """
    u, y = np.asarray(u, dtype=float).ravel(), np.asarray(y, dtype=float).ravel()
    try:
        approximation = bla.estimate(IOData(u, y, Ts))
    except InputError:
        return _welch(u, y, Ts)
    radius = np.sqrt(-np.log(1.0 - LEVEL) * approximation.total_variance)
    return Spectrum(
        approximation.frequency,
        approximation.G,
        radius,
        f"best linear approximation over {approximation.periods} periods",
    )


def _welch(u: np.ndarray, y: np.ndarray, Ts: float) -> Spectrum:
    """The frequency response by Welch's average, where the input has power."""
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


_SAME = 1e-3  # of the input's range: inputs that differ by less are the same


@dataclass(frozen=True)
class Repeat:
    """spread [rad]: RMS of the difference of the two logs about its trend; `by_noise`: what noise of both makes of it.

    offset [rad] is the mean of the difference (first log less second), drift [rad/s] its slope over time, each with an
    interval of level `LEVEL` that allows for coloured differences.
    """

    spread: float
    by_noise: float
    offset: tuple[float, float, float]
    drift: tuple[float, float, float]
    samples: int

    @property
    def drifts(self) -> bool:
        """Whether the interval of the drift excludes zero."""
        return not self.drift[1] <= 0.0 <= self.drift[2]


def repeat(first: IOData, second: IOData, label: str) -> Repeat:
    """The difference of two logs over the samples that both have; raises InputError if their inputs differ."""
    if not same_rate(first.Ts, second.Ts):
        raise InputError(f"the logs have sampling times of {first.Ts:g} and {second.Ts:g} s; resample one of them")
    n = min(first.N, second.N)
    u, u_second = first.u[:n, 0], second.u[:n, 0]
    distance = np.abs(u - u_second)
    if distance.max() > _SAME * max(float(np.ptp(u)), 1e-12):
        k = int(distance.argmax())
        raise InputError(
            f"the inputs differ: {u[k]:g} V and {u_second[k]:g} V in {label} at {k * first.Ts:g} s; logs are compared "
            "under the same input, so record both with one, or compare each with the twin"
        )
    e = first.y[:n, 0] - second.y[:n, 0]
    t = np.arange(n) * first.Ts
    X = np.column_stack([np.ones(n), t - t.mean()])
    beta, *_ = np.linalg.lstsq(X, e, rcond=None)
    rest = e - X @ beta
    half = float(norm.ppf(0.5 + LEVEL / 2)) * sandwich(X, rest)
    (a, b), (da, db) = beta.tolist(), half.tolist()
    noise = float(np.hypot(noise_of(first.y[:n, 0]), noise_of(second.y[:n, 0])))
    spread = float(np.sqrt(np.mean(rest**2)))
    return Repeat(spread, noise, (a, a - da, a + da), (b, b - db, b + db), n)

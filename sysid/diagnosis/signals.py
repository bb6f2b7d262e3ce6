"""Single signals: excitation, levels, rests, converter step; jumps as they were logged; signals that do not move."""

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.quantities import SHARE, display_quantity, unit_of_channel
from sysid.data.record import IOData
from sysid.data.words import word_of
from sysid.data.wraps import DEGREES, unwrapped
from sysid.diagnosis.finding import Advice, channel

_PERSISTENCE_SAMPLES = 20_000  # samples used for the order of excitation
WRAPS = "wraps"
AT_STOPS = "an end stop or a saturation"
_PLACES = ("angle", "angles", "pos", "position", "positions", "theta", "winkel", "stroke", "travel", "opening")
COUNTER_BITS = (8, 16, 24, 32)  # bits of counters, which begin again at 0
ENCODER_COUNTS = (1000.0, 1024.0, 2000.0, 2048.0, 3600.0, 4000.0, 4096.0, 8192.0, 16384.0)  # counts of a turn
NO_VALUE = "as a number that stands for none"
MAP_FILE = "MAP.toml"
# What loggers write for no value: the ends of signed integers, the null of well logs (LAS 2.0). With them go numbers of
# three nines or more, 999 or 99.9, as weather stations fill a field (Integrated Surface Dataset, NOAA).
NONE_WORDS = (-(2.0**15), 2.0**15 - 1, -(2.0**31), 2.0**31 - 1, -999.25, -9999.25)
_FAR_RANGES = 5.0  # ranges of the other samples that lie between these and a number that stands for none
STUCK_SHARE = 0.3  # of the record, for which an output stands still
MIDDLE, COVERED = (0.25, 0.75), (0.1, 0.9)  # quantiles of an input, between those that it has meanwhile


def persistence(u: np.ndarray, highest: int = 50) -> int:
    """Order n of persistent excitation of u (N,): the most lags whose covariance has full rank, up to `highest`.

    The order is the rank of the lag matrix, so a sum of m sines has exactly 2 m (Ljung, System Identification,
    definition 13.2). A singular value below 1e-4 of the largest counts as zero.
    """
    x = np.asarray(u, dtype=float).ravel()[:_PERSISTENCE_SAMPLES]
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

    def share(in_band: np.ndarray) -> float:
        return float(np.mean(in_band[1:-1] & in_band[:-2] & in_band[2:])) if len(in_band) > 2 else 0.0

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
    tail, earlier = g[-longest // 10 :], g[-longest // 5 : -longest // 10]
    if not np.all(np.isfinite(g)) or abs(tail.mean() - earlier.mean()) > 0.02 * float(np.ptp(g)) or tail.mean() == 0:
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


def word_warning(data: IOData, role: str, k: int) -> Advice | None:
    """The warning about input ("u") or output ("y") k if its numbers are words without their sign, beyond doubt."""
    x = data.u[:, k] if role == "u" else data.y[data.observed[:, k], k]
    word = word_of(x)
    if word is None or not word.sure:
        return None
    sentence = f"{channel(data, role, k)} holds {word.kind}, and is read as plain numbers up to {x.max():g}"
    table = "input" if role == "u" else "output"
    todo = f"write the mapping, set {word.entry} in its [[{table}]], and give it with --map"
    return Advice(WRAPS, sentence, word.evidence, todo, "warning", command=("info", "--write-map", MAP_FILE))


def wrap_warning(data: IOData, j: int) -> Advice | None:
    """The warning about output j if it jumps by a turn or as a counter that begins again; None if it does not."""
    name = channel(data, "y", j)
    unit, is_integer = unit_of_channel(data.y_unit, j), not np.any(data.y[:, j] % 1.0)
    missing = None if data.missing is None else data.missing[:, [j]]
    if missing is not None and missing.any():
        return None
    angles = {"rad": (2.0 * math.pi,), "deg": (360.0,), "°": (360.0,)}
    turns = angles.get(unit, tuple(2.0**bits for bits in COUNTER_BITS) + ENCODER_COUNTS if is_integer else ())
    for turn in turns:
        y = [e.y[:, j] for e in data.experiments]
        if max(float(np.ptp(part)) for part in y) < 0.7 * turn:
            continue
        parts = [unwrapped(IOData(e.u, e.y[:, j], e.Ts), turn) for e in data.experiments]
        count = sum(part.count for part in parts)
        if not count:
            continue
        times = "once" if count == 1 else f"{count} times"
        bits = next((bits for bits in COUNTER_BITS if turn == 2.0**bits), 0)
        if bits and unit not in angles:
            sentence = f"{name} is a counter of {bits} bits that passes 0 {times}, not an output that jumps"
        else:
            sentence = (
                f"{name} jumps {times} by a turn of {turn:.4g} {unit or 'counts'}, as a sensor within one turn does"
            )
        todo = "log the angle over turns, or undo the wraps in Python before the fit"
        return Advice(WRAPS, sentence, count, todo, "warning", call="sysid.data.wraps.unwrapped(data).data")
    return None


def none_word(x: np.ndarray, factor: float = 1.0) -> float | None:
    """The number at an end of x (N,) that loggers write for no value, if it lies far outside the others; else None.

    `factor` is from the stored unit to the one that the file shows. One sample is enough, and any number of them.
    """
    for end in (float(x.min()), float(x.max())):
        shown = f"{end * factor:.10g}"
        nines = shown.lstrip("-").replace(".", "")
        is_word = (len(nines) >= 3 and set(nines) == {"9"}) or float(shown) in NONE_WORDS
        if is_word and missing_code(x, x == end, least=1) is not None:
            return end
    return None


def without_words(data: IOData) -> tuple[IOData, dict[tuple[str, int], np.ndarray]]:
    """The record with the samples that stand for none missing, the last input held, and where they are by channel.

    All other findings are then about what was measured: one -999 in an input looks like feedback to a test.
    """
    u, missing, places = data.u.copy(), ~data.observed, dict[tuple[str, int], np.ndarray]()
    for role, values, unit in (("u", data.u, data.u_unit), ("y", data.y, data.y_unit)):
        for k in range(values.shape[1]):
            x = values[:, k] if role == "u" else values[data.observed[:, k], k]
            code = none_word(x, display_quantity("", unit_of_channel(unit, k)).factor)
            if code is None or word_warning(data, role, k) is not None:
                continue
            places[role, k] = mask = values[:, k] == code
            if role == "u":
                last = np.maximum.accumulate(np.where(mask, -1, np.arange(data.N)))
                u[:, k] = u[np.where(last < 0, np.argmin(mask), last), k]
            else:
                missing[:, k] |= mask
    return (replace(data, u=u, missing=missing if missing.any() else None), places) if places else (data, places)


def missing_code(y: np.ndarray, mask: np.ndarray, least: int = 2) -> float | None:
    """The number that all found samples (N,) have, if it lies far outside the others, as -9999 does; else None."""
    odd, sound = np.unique(y[mask]), y[~mask]
    if len(odd) != 1 or not len(sound) or mask.sum() < least or not np.ptp(sound):
        return None
    distance = max(float(sound.min()) - odd[0], odd[0] - float(sound.max()))
    return float(odd[0]) if distance > _FAR_RANGES * float(np.ptp(sound)) else None


def constant_warning(data: IOData, role: str, k: int) -> Advice | None:
    """The warning about input ("u") or output ("y") k if all its samples are one number; None if it moves."""
    values, unit = (data.u[:, k], data.u_unit) if role == "u" else (data.y[:, k], data.y_unit)
    if np.ptp(values) != 0.0:
        return None
    level = _value_in_words(float(values[0]), unit_of_channel(unit, k))
    sentence = f"{channel(data, role, k)} is {level} in all {data.N} samples"
    cause = (
        "it excites nothing, so the record shows no model"
        if role == "u"
        else "a sensor that does not read, or a plant that did not move"
    )
    todo = f"record again while the {'input' if role == 'u' else 'output'} moves, or choose another column"
    return Advice("data", f"{sentence}: {cause}", float(data.N), todo, "warning")


def stuck_warning(data: IOData, j: int) -> Advice | None:
    """The warning about output j if it has one and the same reading for a large part of the record while an input
    goes on to both sides, so that an end stop would be left; None if it does not."""
    y = data.y[:, j]
    edges = np.flatnonzero(np.concatenate([[True], np.diff(y) != 0.0, [True]]))
    runs = np.diff(edges)
    longest = int(np.argmax(runs))
    first, n = int(edges[longest]), int(runs[longest])
    samples = np.arange(data.N)
    in_rest = (samples >= first) & (samples < first + n)
    if n < STUCK_SHARE * data.N or in_rest.all() or len(data.lengths) > 1 or not data.observed[in_rest, j].all():
        return None
    low, high = np.quantile(data.u, MIDDLE, axis=0)
    now_low, now_high = np.quantile(data.u[in_rest], COVERED, axis=0)
    if not np.any((now_low < low) & (high < now_high)):
        return None
    start, stop = first * data.Ts, (first + n) * data.Ts
    share = 100.0 * n / data.N
    place = _value_in_words(float(y[first]), unit_of_channel(data.y_unit, j))
    sentence = (
        f"{channel(data, 'y', j)} stands at {place} from {start:.4g} s to {stop:.4g} s, "
        f"{share:.0f} % of the record, while the input moves: a sensor that died, or a plant that stuck"
    )
    end = first + n >= data.N
    moving_part = (0.0, start) if end or first >= data.N - first - n else (stop, data.N * data.Ts)
    span = f"{moving_part[0]:.4g}:{moving_part[1]:.4g}" if end or moving_part[0] == 0.0 else f"{moving_part[0]:.4g}:"
    return Advice(
        "data", sentence, share, "use the part in which it moves", "warning", command=("identify", "--range", span)
    )


def _value_in_words(value: float, unit: str) -> str:
    q = display_quantity("", unit)
    return f"{value * q.factor:.4g} {q.unit}".rstrip()


def may_be_place(unit: str, name: str) -> bool:
    """Whether an output may be a place, which end stops bound: an angle, a length, or a number without a unit.

    Another unit is none of a place, and per cent only where the name says of what: a valve's position, no level.
    """
    of_place = any(word in _PLACES for word in re.split(r"[\W\d_]+", name.lower()))
    return unit in ("", "1", "counts", "rad", "m", *DEGREES) or (unit == SHARE and of_place)

"""Outliers: samples far from their neighbours by Hampel's rule; they are interpolated or marked as missing."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.data.record import IOData

_FLICKER = 0.005  # of the range of the output


@dataclass(frozen=True)
class Outliers:
    """Outliers of the outputs: `found` (N, ny), their sample numbers in `indices`, and the treated record."""

    data: IOData
    found: np.ndarray
    sentence: str

    @property
    def indices(self) -> tuple[tuple[int, ...], ...]:
        """Sample numbers (from 0) for each output."""
        return tuple(tuple(np.flatnonzero(column).tolist()) for column in self.found.T)


@checked(deferred=("y",))
def hampel(y: np.ndarray, half_width: int = 5, threshold: float = 5.0, floor: float | None = None) -> np.ndarray:
    """True (N,) where y (N,) is over threshold robust spreads from the median of its 2 half_width + 1 neighbours.

    The spread is 1.4826 times the median absolute deviation of the window (Hampel 1974; Pearson 2002, Outliers in
    process modeling and identification). `floor` is the least spread. By default it is the noise in the second
    differences of the whole record, or the smallest step between its values, so that the quantisation of a signal at
    rest does not count as outliers. In white noise about one sample in a million is flagged by chance at the defaults,
    one in 15,000 at threshold 4.
    """
    y = np.asarray(y, dtype=float).ravel()
    if not (isinstance(half_width, (int, np.integer)) and half_width >= 1 and threshold > 0):
        raise InputError(f"half_width is {half_width} and threshold {threshold}; give at least 1 and more than 0")
    if len(y) < 2 * half_width + 1:
        raise InputError(f"{len(y)} samples are too few for windows of {2 * half_width + 1}; give a smaller half_width")
    padded = np.pad(y, half_width, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half_width + 1)
    median = np.median(windows, axis=1)
    spread = 1.4826 * np.median(np.abs(windows - median[:, None]), axis=1)
    return np.abs(y - median) > threshold * np.maximum(spread, _floor(y) if floor is None else floor)


def returning(y: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Those of the found samples (N,) that lie further from both neighbours than these from each other.

    The neighbours are the nearest samples that are not found. A sudden move does not come back. What is further away
    by a small share of the range only, as the flicker of a converter at rest, hardly moves a fit.
    """
    least = _FLICKER * float(np.ptp(y[~mask])) if not mask.all() else 0.0
    sound = np.flatnonzero(~mask)
    isolated = np.zeros(len(y), dtype=bool)
    for t in np.flatnonzero(mask):
        k = int(np.searchsorted(sound, t))
        previous_value, next_value = y[sound[max(k - 1, 0)]], y[sound[min(k, len(sound) - 1)]]
        isolated[t] = min(abs(y[t] - previous_value), abs(y[t] - next_value)) > max(
            2.0 * abs(next_value - previous_value), least
        )
    return isolated


@checked
def outliers(data: IOData, treat: str = "missing", half_width: int = 5, threshold: float = 5.0) -> Outliers:
    """Outliers of every output, per experiment; treat 'missing' marks them, 'interpolate' replaces them by lines.

    A fit ignores marked samples. Interpolated samples count as if they had been measured, for tools that cannot skip
    samples. Inputs are not changed: a commanded input is exact, steps included.
    """
    if treat not in ("missing", "interpolate"):
        raise InputError(f"treat is {treat!r}; choose one of missing, interpolate")
    found = np.zeros(data.y.shape, dtype=bool)
    end = 0
    for e in data.experiments:
        for j in range(e.y.shape[1]):
            found[end : end + e.N, j] = hampel(e.y[:, j], half_width, threshold)
        end += e.N
    found &= data.observed
    if not found.any():
        return Outliers(data, found, f"no output differs from its neighbours by {threshold:g} robust spreads")
    mask = found | ~data.observed
    treated = replace(data, missing=mask)
    if treat == "interpolate":
        treated = replace(data, y=np.where(found, treated.y, data.y))
    first = ", ".join(map(str, np.flatnonzero(found.any(axis=1))[:5]))
    treatment = "marked as missing" if treat == "missing" else "replaced by straight lines"
    ellipsis = ", ..." if found.any(axis=1).sum() > 5 else ""
    sentence = (
        f"{int(found.sum())} of {found.size} outputs ({100 * found.mean():.2g} %) differ from their neighbours by more "
        f"than {threshold:g} robust spreads and were {treatment}: samples {first}{ellipsis}"
    )
    return Outliers(treated, found, sentence)


def _floor(y: np.ndarray) -> float:
    """Noise level of the record from its second differences, at least the step between its values."""
    second = np.abs(np.diff(y, 2))
    noise = 1.4826 * float(np.median(second)) / np.sqrt(6.0) if len(second) else 0.0
    steps = np.diff(np.unique(y))
    # A converter value may differ by one step without being an outlier.
    return max(noise, float(np.median(steps)) if 0 < len(steps) < len(y) // 4 else 0.0, 1e-12 * float(np.ptp(y)))

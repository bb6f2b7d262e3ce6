"""From increasing time stamps to a uniform grid: which sample number a stamp has, or that it needs interpolation."""

from dataclasses import dataclass

import numpy as np

COARSE = 0.4  # of a step: a last digit above it cannot tell a lost sample from rounding
LONG = 1.5  # times the usual step: samples are lost
ROUNDED = 1.3  # last digits over which rounded stamps of a uniform clock spread about a straight line (1 in theory)
SPARSE = 100.0  # middle steps: a longer one is a gap however often there is one
MOST = 2.0**40  # steps in a gap: a longer one is refused alike, and sums of these are whole numbers
RELIABLE = 0.45  # of a step by which stamps may be off a grid before their sample numbers are uncertain


@dataclass(frozen=True)
class Grid:
    """A uniform grid of N samples every Ts [s] from the first stamp.

    `index` (n,) is the sample of each stamp; None if the stamps are not uniform, then values are interpolated.
    `gaps` (m, 2) holds the position of the stamp before each long step and the number of samples lost in it.
    `median` [s] is the middle step, `off` [s] the largest distance of a stamp from the grid.
    """

    Ts: float
    N: int
    index: np.ndarray | None
    gaps: np.ndarray
    median: float
    off: float

    @property
    def lost(self) -> int:
        """Samples lost between stamps."""
        return int(self.gaps[:, 1].sum())


def find_grid(t: np.ndarray, resolution: float, jitter: float, Ts: float | None = None) -> Grid | None:
    """The grid of stamps t (n,) [s], which increase; None if the last digit `resolution` [s] is too coarse to tell.

    `jitter` is the part of a step by which stamps may be off. A `Ts` [s] near the step of the stamps is taken for it;
    another one is a whole number of steps of the grid where values are interpolated anyway.
    """
    steps = np.diff(t)
    median = float(np.median(steps))
    near = Ts if Ts is not None and abs(Ts - median) <= max(0.01 * median, resolution) else None
    alike = _distance(steps, median) <= max(1.01 * resolution, 0.01 * median)
    single = steps if alike.all() else steps[alike]
    step = near or (float(single.mean()) if len(single) else median)
    rounding = 0.0 if resolution >= COARSE * step else resolution
    if near is None and resolution >= COARSE * step and _is_rounded(t, steps, median, jitter):
        return None
    numbers = _numbers(t, steps, step, near is not None)
    if numbers is not None:
        index, step = numbers
        m = np.diff(index)
        off = _off(t, index, step)
        by_steps = np.all(_distance(steps, m * step) <= jitter * step)
        allowed = max(2.0 * jitter * step, ROUNDED * rounding, ROUNDED * resolution if near else 0.0)
        if by_steps or 2.0 * off <= allowed:
            exact = near or _exact(t, index, step, max(rounding, 2.0 * off))
            gaps = np.flatnonzero(m > 1)
            return Grid(exact, int(index[-1]) + 1, index, np.column_stack([gaps, m[gaps] - 1]), median, off)
        if off < RELIABLE * step:
            median = step
    fine = near or (Ts / max(1, round(Ts / median)) if Ts is not None else three_digits(median))
    usual = max(min(float(np.percentile(steps, 95)), SPARSE * median), fine)
    gaps = np.flatnonzero(steps > LONG * usual)
    lost = np.maximum(np.minimum(np.rint(steps[gaps] / usual), MOST).astype(int) - 1, 1)
    N = int((t[-1] - t[0]) / fine * (1.0 + 1e-12) + 1e-6) + 1
    off = _off(t, np.rint((t - t[0]) / fine), fine)
    return Grid(fine, N, None, np.column_stack([gaps, lost]), float(np.median(steps)), off)


def three_digits(value: float) -> float:
    """A step that is free to choose, as a number that a person would write."""
    return float(f"{value:.3g}")


def _is_rounded(t: np.ndarray, steps: np.ndarray, median: float, jitter: float) -> bool:
    """Whether the steps of a coarse clock differ by rounding: not by whole steps, or evenly over the record."""
    other = np.abs(steps - median) > jitter * median
    if np.any(np.abs(steps - median * np.maximum(np.rint(steps / median), 1.0)) > jitter * median):
        return True
    k = np.arange(len(t))  # as if no sample were lost
    return int(other.sum()) > 1 and bool(np.ptp(t - _slope(k, t) * k) <= ROUNDED * median)


def _numbers(t: np.ndarray, steps: np.ndarray, step: float, given: bool) -> tuple[np.ndarray, float] | None:
    """Sample number of each stamp (n,), and the step [s]; None if two stamps would have one number."""
    if not given and np.all(_distance(steps, step) < 0.25 * step):  # most logs: none is lost, and memory is saved
        index = np.arange(len(t))
        return index, _slope(index, t)
    for _ in range(3):
        m = np.minimum(np.rint(steps / step), MOST).astype(np.int64)
        if m.min() < 1:
            return None
        index = np.concatenate([[0], np.cumsum(m)])
        if given:
            return index, step
        ones = m == 1
        step = float(steps[ones].mean()) if ones.any() else step
    slope = _slope(index, t)
    # A line through all stamps is the better step only as long as it gives every step its number.
    if np.array_equal(np.rint(steps / slope), m):
        step = slope
    return index, step


def _slope(index: np.ndarray, t: np.ndarray) -> float:
    """The slope of the straight line of least squares."""
    centred = index - index.mean()
    return float(centred @ t / (centred @ centred))


def _off(t: np.ndarray, index: np.ndarray, step: float) -> float:
    left = step * index
    np.subtract(t, left, out=left)
    return float(0.5 * np.ptp(left))


def _distance(values: np.ndarray, others: np.ndarray | float) -> np.ndarray:
    """|values - others| in one array, since a long record has few to spare."""
    found = np.subtract(values, others)
    return np.abs(found, out=found)


def _exact(t: np.ndarray, index: np.ndarray, step: float, spread: float) -> float:
    """The step [s]: printed times are rounded, their mean is not, and a short number within their spread is meant."""
    span = float(index[-1])
    mean = float(t[-1] - t[0]) / span
    uncertain = spread / span
    for digits in range(1, 9):
        short = float(f"{mean:.{digits}g}")
        if abs(short - mean) <= uncertain and abs(short - step) <= 2.0 * uncertain:
            return short
    return float(f"{mean:.9g}")

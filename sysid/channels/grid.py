"""From increasing time stamps to a uniform grid: the sample number of each stamp, the gaps, and the values on the grid.

Stamps that are off by less than half a step number their rows all the same, and the rows are the samples. Where
deviations add up, or the outputs say that each was sampled at its stamp, values are interpolated and inputs are the
mean of each step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.jitter import sampled_at_stamps
from sysid.channels.mapping import Channel, ChannelMap
from sysid.channels.signals import most_samples
from sysid.channels.stamps import Stamps, note_on_change_of_clocks, values_at
from sysid.data.missing import fill, runs
from sysid.data.resampling import mean_of_held
from sysid.data.table import Table

# Limits chosen by hand; the logs of tests/corpus hold them.
COARSE = 0.4  # of a step: a last digit above it cannot tell a lost sample from rounding
LONG = 1.5  # times the usual step: samples are lost
ROUNDED = 1.3  # last digits over which rounded stamps of a uniform clock spread about a straight line (1 in theory)
SPARSE = 100.0  # middle steps: a longer one is a gap however often there is one
MOST = 2.0**40  # steps in a gap: a longer one is refused alike, and sums of these are whole numbers
RELIABLE = 0.45  # of a step by which stamps may be off a grid before their sample numbers are uncertain
TRACKING = 0.1  # of a stamp's deviation, by which the clock follows it: the mean of some ten


@dataclass(frozen=True)
class Grid:
    """A uniform grid of N samples every Ts [s] from the first stamp.

    `index` (n,) is the sample of each stamp; None if the stamps are not uniform, then values are interpolated.
    `gaps` (m, 2) holds the position of the stamp before each long step and the number of samples lost in it.
    `median` [s] is the middle step, `off` [s] the largest distance of a stamp from the grid. `loose` says that stamps
    are further off than they may be, and rows are samples all the same.
    """

    Ts: float
    N: int
    index: np.ndarray | None
    gaps: np.ndarray
    median: float
    off: float
    loose: bool = False

    @property
    def lost(self) -> int:
        """Samples lost between stamps."""
        return int(self.gaps[:, 1].sum())


def find_grid(
    t: np.ndarray, resolution: float, jitter: float, Ts: float | None = None, y: Sequence[np.ndarray] = ()
) -> Grid | None:
    """The grid of stamps t (n,) [s], which increase; None if the last digit `resolution` [s] is too coarse to tell.

    `jitter` is the part of a step by which stamps may be off whatever the outputs `y` (n,) say. A `Ts` [s] near the
    step of the stamps is taken for it; another one is a whole number of steps of the grid where values are interpolated
    anyway.
    """
    steps = np.diff(t)
    median = float(np.median(steps))
    given_step = Ts if Ts is not None and abs(Ts - median) <= max(0.01 * median, resolution) else None
    usual_steps = _distance(steps, median) <= max(1.01 * resolution, 0.01 * median)
    single = steps if usual_steps.all() else steps[usual_steps]
    step = given_step or (float(single.mean()) if len(single) else median)
    rounding = 0.0 if resolution >= COARSE * step else resolution
    if given_step is None and resolution >= COARSE * step and _is_rounded(t, steps, median, resolution, jitter):
        return None
    numbering = _sample_numbers(t, steps, step, given_step is not None)
    if numbering is None or _distance_from_grid(t, *numbering) >= RELIABLE * numbering[1]:
        numbering = _tracked_numbers(t, step, given_step is not None) or numbering
    if numbering is not None:
        index, step = numbering
        m = np.diff(index)
        deviation = _distance_from_grid(t, index, step)
        steps_fit = np.all(_distance(steps, m * step) <= jitter * step)
        tolerance = max(2.0 * jitter * step, ROUNDED * rounding, ROUNDED * resolution if given_step else 0.0)
        within, numbered = bool(steps_fit or 2.0 * deviation <= tolerance), deviation < RELIABLE * step
        if within or (numbered and not sampled_at_stamps(t, index, step, y)):
            exact = given_step or _exact(t, index, step, max(rounding, 2.0 * deviation))
            gaps = np.flatnonzero(m > 1)
            losses = np.column_stack([gaps, m[gaps] - 1])
            return Grid(exact, int(index[-1]) + 1, index, losses, median, deviation, not within)
        if numbered:
            median = step
    chosen_step = given_step or (Ts / max(1, round(Ts / median)) if Ts is not None else three_digits(median))
    usual = max(min(float(np.percentile(steps, 95)), SPARSE * median), chosen_step)
    gaps = np.flatnonzero(steps > LONG * usual)
    lost = np.maximum(np.minimum(np.rint(steps[gaps] / usual), MOST).astype(int) - 1, 1)
    N = int((t[-1] - t[0]) / chosen_step * (1.0 + 1e-12) + 1e-6) + 1
    deviation = _distance_from_grid(t, np.rint((t - t[0]) / chosen_step), chosen_step)
    return Grid(chosen_step, N, None, np.column_stack([gaps, lost]), float(np.median(steps)), deviation)


def three_digits(value: float) -> float:
    """A step that is free to choose, as a number that a person would write."""
    return float(f"{value:.3g}")


def _is_rounded(t: np.ndarray, steps: np.ndarray, median: float, resolution: float, jitter: float) -> bool:
    """Whether the steps of a coarse clock differ by rounding: not by whole steps, or as a uniform clock's do.

    Rounded stamps of a uniform clock, of which no sample is lost, lie in a strip of the height of their last digit.
    """
    unusual = np.abs(steps - median) > jitter * median
    if np.any(np.abs(steps - median * np.maximum(np.rint(steps / median), 1.0)) > jitter * median):
        return True
    return int(unusual.sum()) > 1 and _strip(t) <= resolution + 2.0 * jitter * median


def _strip(t: np.ndarray) -> float:
    """The height [s] of the lowest strip between two parallel lines that holds all t (n,) over their row numbers."""
    from scipy.optimize import minimize_scalar

    k = np.arange(len(t))
    slope = _slope(k, t)
    reach = 2.0 * float(np.ptp(t - slope * k)) / len(t)  # a line that is further off leaves a higher strip
    bounds, options = (slope - reach, slope + reach), {"xatol": 1e-4 * reach}
    return float(minimize_scalar(lambda each: np.ptp(t - each * k), bounds=bounds, options=options).fun)


def _sample_numbers(t: np.ndarray, steps: np.ndarray, step: float, given: bool) -> tuple[np.ndarray, float] | None:
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


def _tracked_numbers(t: np.ndarray, step: float, given: bool) -> tuple[np.ndarray, float] | None:
    """Sample number of each stamp (n,), and the step [s], of stamps whose steps alone do not tell them; None if none.

    Each is the nearest sample of a clock that follows the stamps slowly: two neighbours that are late and early are
    less than half a step off it, though the step between them is not near a whole number.
    """
    for _ in range(1 if given else 3):
        number, phase, numbers = 0, float(t[0]), [0]
        for stamp in t[1:].tolist():
            number = max(number + 1, round(min((stamp - phase) / step, MOST)))
            phase += TRACKING * (stamp - number * step - phase)
            numbers.append(number)
        index = np.array(numbers)
        step = step if given else _slope(index, t)
    return (index, step) if _distance_from_grid(t, index, step) < RELIABLE * step else None


def _slope(index: np.ndarray, t: np.ndarray) -> float:
    """The slope of the straight line of least squares."""
    centred_index = index - index.mean()
    return float(centred_index @ t / (centred_index @ centred_index))


def _distance_from_grid(t: np.ndarray, index: np.ndarray, step: float) -> float:
    residuals = step * index
    np.subtract(t, residuals, out=residuals)
    return float(0.5 * np.ptp(residuals))


def _distance(values: np.ndarray, reference: np.ndarray | float) -> np.ndarray:
    """|values - others| in one array, since a long record has few to spare."""
    distance = np.subtract(values, reference)
    return np.abs(distance, out=distance)


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


def check_gaps(table: Table, mapping: ChannelMap, stamps: Stamps, grid: Grid) -> None:
    """Raises InputError with the row of the first gap that is not filled, and with what to do."""
    repair, lengths = mapping.repair, grid.gaps[:, 1]
    if len(lengths) and lengths.max() > repair.longest_gap:
        first = int(np.argmax(lengths > repair.longest_gap))
        raise _gap_error(table, mapping, stamps, grid, first, f"at most {repair.longest_gap} in a row are filled")
    if grid.lost > repair.most_lost * grid.N:
        share = f"{grid.lost} of {grid.N} samples are lost, and at most {repair.most_lost:.0%} are filled"
        raise _gap_error(table, mapping, stamps, grid, int(np.argmax(lengths)), share)


def _gap_error(table: Table, mapping: ChannelMap, stamps: Stamps, grid: Grid, gap: int, reason: str) -> InputError:
    """The error for a gap, with one remedy: the longest piece between long gaps, or to fill where gaps are short."""
    clock, repair, lengths = mapping.clock, mapping.repair, grid.gaps[:, 1]
    if clock.Ts is not None and clock.Ts < grid.median / LONG:
        least = grid.median / (repair.longest_gap + 1)
        return InputError(
            f"{table.path}: Ts of [clock] is {clock.Ts:g} s and most steps of column {clock.column!r} are "
            f"{grid.median:.4g} s, and {reason}; give Ts of at least {least:.4g} s, or leave it out"
        )
    k = int(grid.gaps[gap, 0])
    step = stamps.t[k + 1] - stamps.t[k]
    tolerance = f" (within {repair.jitter:.0%})" if grid.index is not None else ""
    ends = grid.gaps[lengths > min(repair.longest_gap, int(lengths.max()) - 1), 0]
    starts, stops = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(stamps.t) - 1]])
    j = int(np.argmax(stops - starts))
    remedy = (
        f"keep the longest piece, {stops[j] - starts[j] + 1} of {len(stamps.t)} rows, with "
        f"--range {stamps.t[starts[j]]:.10g}:{stamps.t[stops[j]]:.10g}"
    )
    # A short gap is worth filling; across a long one a straight line is no output, and spoils what is beside it.
    is_short = lengths.max() <= repair.longest_gap or stops[j] == starts[j]
    if is_short and most_samples(len(stamps.t)) >= grid.N:
        remedy = "set longest_gap and most_lost in [repair] of a mapping"
    return table.error(
        clock.column,
        int(stamps.rows[k + 1]),
        f"found a step of {step:.4g} s where most are {grid.median:.4g} s{tolerance}"
        f"{note_on_change_of_clocks(table, clock, step, grid.median)}, and {reason}; {remedy}",
    )


@dataclass(frozen=True)
class Timing:
    """When the rows of a table were sampled: their stamps, None without a clock; their grid; the rows that are used."""

    stamps: Stamps | None
    grid: Grid
    rows: np.ndarray


def value_of_each_stamp(values: np.ndarray, timing: Timing, mean: bool) -> np.ndarray:
    """One value for each stamp: of the first of its rows, or their mean."""
    stamps = timing.stamps
    if stamps is None or not mean or not stamps.repeated:
        return values_at(values, timing.rows)
    member = stamps.group >= 0
    group, member_values = stamps.group[member], values[member]
    mask = np.isfinite(member_values)
    total = np.bincount(group[mask], member_values[mask], len(stamps.t))
    count = np.bincount(group[mask], minlength=len(stamps.t))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def place(
    table: Table, timing: Timing, channel: Channel, values: np.ndarray, role: str, longest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Values (N,) on the grid and the marks (N,) of samples that were filled, at most `longest` in a row.

    Where values are interpolated, an input that is held becomes its mean over each step of the grid: at a single
    instant it would come a whole step late. Raises InputError with the row of a longer stretch of `values` (n,)
    without one, and of one at an end.
    """
    grid, mask, held = timing.grid, np.isfinite(values), channel.is_held(role)
    if grid.index is not None:
        if len(values) == grid.N and mask.all():
            return values, np.zeros(grid.N, dtype=bool)
        y = np.full(grid.N, np.nan)
        y[grid.index] = values
        bridge = fill(y, longest, hold=held)
        _check_filled(table, timing, channel, bridge.open, longest)
        return bridge.values, bridge.filled
    stamps = timing.stamps
    assert stamps is not None
    is_open = np.zeros(len(mask), dtype=bool)
    for start, stop in runs(~mask):
        is_open[start:stop] = stop - start > longest or start == 0 or stop == len(mask)
    _check_filled(table, timing, channel, is_open, longest)
    t, x = stamps.t[mask], values[mask]
    times = np.arange(grid.N) * grid.Ts
    later = np.searchsorted(t, times * (1.0 + 1e-12) + 1e-9 * grid.Ts, side="right")
    earlier = np.maximum(later - 1, 0)
    y = x[earlier] if held else np.interp(times, t, x)
    if held and role == "input":
        y = mean_of_held(t, x, times, times + grid.Ts)
    usual = max(float(np.percentile(np.diff(stamps.t), 95)), grid.Ts)
    following = np.append(t, np.inf)[later]
    distant = times - t[earlier] > 0.5 * usual
    if not held:
        distant &= following - times > 0.5 * usual
    return y, distant & (later < len(t)) & (following - t[earlier] > LONG * usual)


def _check_filled(table: Table, timing: Timing, channel: Channel, is_open: np.ndarray, longest: int) -> None:
    """Raises InputError with the row of the first samples `open_` (N,) or stamps (n,) that could not be filled."""
    if not is_open.any():
        return
    start, stop = runs(is_open)[0]
    grid = timing.grid
    index = grid.index if grid.index is not None and len(is_open) == grid.N else np.arange(len(is_open))
    k = min(int(np.searchsorted(index, start)), len(timing.rows) - 1)
    raise table.error(
        channel.column,
        int(timing.rows[k]),
        f"found no value in {stop - start} samples in a row, where at most {longest} are filled, and none at an end; "
        "keep another part with --range, or set longest_gap in [repair] of a mapping",
    )

"""Where a clock starts again: another experiment, which no row of the one before it may join."""

from dataclasses import dataclass

import numpy as np

from sysid.data.table import Table

# Limits chosen by hand; the logs of tests/corpus and of tests/contracts/test_restarts.py hold them.
SHORTEST = 10  # rows: a shorter stretch is no experiment to fit, and more is asked of it to be one at all
FEWEST = 3  # rows of a stretch: fewer are a fault of single stamps
GOES_ON = 3.0  # usual steps: what follows a restart steps by no more, where a single bad stamp jumps back
EVENLY = 1.5  # usual steps: the same in a stretch of few rows
WANDERS = 10.0  # middle departures: further off, a clock does not wander, it was set
AGAIN = 0.1  # of the rows of a stretch: how near its first stamp the clock starts again


def usual_step(values: np.ndarray) -> float:
    """The middle step of values (n,) between those that rise, 0 if none does."""
    steps = np.diff(values)
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0


def restarts(stamps: np.ndarray, table: Table | None = None) -> np.ndarray:
    """Places (m,) in stamps (n,) at which the clock falls and goes on from there: near where it first began, or
    through times that the rows before it have already.

    Rows that came out of order fill times that none has. Rows of the `table` that a logger wrote twice are the rows
    before them, cell by cell.
    """
    places = np.flatnonzero(np.isfinite(stamps))
    values = stamps[places]
    falls = np.flatnonzero(np.diff(values) < 0) + 1
    if not len(falls) or len(values) < SHORTEST:
        return np.zeros(0, dtype=int)
    step, first, starts, times = usual_step(values), values[0], [0], _Times.of(values)
    for k in falls.tolist():
        following = np.diff(values[k : k + SHORTEST])  # up to the end, or to where it falls again
        following = following[: int(np.argmax(following < 0))] if np.any(following < 0) else following
        before, after = k - starts[-1], len(following) + 1
        few = min(before, after) < SHORTEST
        if min(before, after) < FEWEST:
            continue
        # Stamps of events have no even step: ten in a row below the last one are no fault of a single stamp either.
        below = after == SHORTEST and values[k + after - 1] < values[k - 1] and not few
        if not below and following.max() > (EVENLY if few else GOES_ON) * step:
            continue
        near = values[k] <= first + (0.5 if few else max(AGAIN * before, GOES_ON)) * step
        # Fewer rows behind are left out in any case, be it as a fault of the stamps or as a short stretch.
        if near or (
            after == SHORTEST
            and len(times.between(values[k], values[k + after - 1], starts[-1], k)) >= FEWEST
            and not (table is not None and _written_twice(table, places, times, starts[-1], k))
        ):
            starts.append(k)
    return places[np.array(starts[1:], dtype=int)]


def pauses(stamps: np.ndarray, longest: int, every: bool = False) -> np.ndarray:
    """Places (m,) in stamps (n,) behind a pause that is longer than the stretches of rows on either side of it, or
    `every` one of more than `longest` samples, which are filled.

    To fill such a pause would take more samples than were recorded there: it lies between experiments.
    """
    places = np.flatnonzero(np.isfinite(stamps))
    values = stamps[places]
    steps, step = np.diff(values), usual_step(values)
    (long,) = np.nonzero(steps > max(longest + 1.5, 0.0 if every else SHORTEST) * step)
    if step <= 0 or not len(long):
        return np.zeros(0, dtype=int)
    borders = np.unique(np.concatenate([[0], long + 1, np.flatnonzero(steps < 0) + 1, [len(values)]]))
    spans, enough = values[borders[1:] - 1] - values[borders[:-1]], np.diff(borders) >= SHORTEST
    k = np.searchsorted(borders, long + 1)
    apart = (steps[long] > np.maximum(spans[k - 1], spans[k])) & enough[k - 1] & enough[k]
    return places[long[apart | every] + 1]


def shortened(steps: np.ndarray, step: float) -> np.ndarray:
    """Places (m,) of steps (n,) that are shorter than the usual `step`, where the clock stays ahead.

    A stamp that came late or early is made up for by the next ones, and a lost sample takes whole steps. Over as many
    steps as an experiment has at least, the clock is therefore ahead by more than it wanders otherwise.
    """
    if len(steps) <= SHORTEST or step <= 0:
        return np.zeros(0, dtype=int)
    ahead = np.convolve(step - steps, np.ones(SHORTEST + 1), "same")
    usual = float(np.median(ahead))
    limit = max(AGAIN * step, WANDERS * float(np.median(np.abs(ahead - usual))))
    (places,) = np.nonzero((ahead - usual > limit) & (step - steps > 0.5 * (ahead - usual)))
    return places


@dataclass(frozen=True)
class _Times:
    """Stamps (n,) and their order, in which the rows of a span of time are found without a look at the others."""

    values: np.ndarray
    order: np.ndarray
    ordered: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray) -> "_Times":
        order = np.argsort(values, kind="stable")
        return cls(values, order, values[order])

    def between(self, low: float, high: float, start: int, stop: int) -> np.ndarray:
        """The rows from `start` to `stop` whose stamps lie between these, both included."""
        first, last = np.searchsorted(self.ordered, low, "left"), np.searchsorted(self.ordered, high, "right")
        rows = self.order[first:last]
        return rows[(rows >= start) & (rows < stop)]


def _written_twice(table: Table, places: np.ndarray, times: _Times, start: int, k: int) -> bool:
    """Whether the rows from k on, up to the last stamp before them, are rows from `start` to k again in all cells.

    Signals at rest are alike in all rows, which says nothing.
    """
    values = times.values
    behind = values[k:]
    again = np.arange(k, k + int(np.argmax(behind > values[k - 1]) if np.any(behind > values[k - 1]) else len(behind)))
    former = times.between(values[k], values[k - 1], start, k)
    if len(again) < 2 or len(former) != len(again) or not np.array_equal(values[former], values[again]):
        return False
    cells = [np.asarray(column) for column in table.columns if len(column) > places[-1]]
    pairs = [(column[places[former]], column[places[again]]) for column in cells]
    moved = sum(len(np.unique(first)) > 1 for first, _ in pairs)
    return moved > 1 and all(_equal(first, second) for first, second in pairs)


def _equal(first: np.ndarray, second: np.ndarray) -> bool:
    return np.array_equal(first, second, equal_nan=first.dtype.kind == "f" and second.dtype.kind == "f")

"""Folds of a record, of interleaved blocks that are experiments of their own: two whose parts both meet what the record
shows, and six whose parts differ in kind."""

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData

COUNTS = (2, 3, 4, 5, 6, 7, 8, 10)  # blocks that are tried
_SHIFT = 0.125  # of a block, by which its border may move: of two blocks none is longer than twice the other
_SHORTEST = 100  # samples of a block of a record that allows more than two
_BALANCE = 0.35  # least share of the samples in each part
_PRICE = 0.01  # of the coverage that one more block must bring: every block loses the samples of its initial state
_MARGIN = 0.02  # of the range of the output, by which a sample may be beyond it
_LEAST = 0.3  # share of the unseen samples that must remain to judge
_CLOSE = 6  # choices of blocks, of each count, whose folds are compared
_BINS, _CELLS = 12, 5  # of each signal, and of each in the plane of both


@dataclass(frozen=True)
class Fold:
    """A part to fit, and the unseen part that judges the fit.

    The first `skip` samples of each unseen experiment give its initial state and are not judged. Neither is what
    follows once its output leaves the range of the part to fit: an end that a record meets once cannot be in both
    parts, no model could know it, and a plant that integrates carries the error on.
    """

    estimation: IOData
    unseen: IOData
    skip: int

    @property
    def judged(self) -> np.ndarray:
        """True (N,) for the unseen samples that count."""
        scored = self._after & self.known
        return scored if scored.sum() >= _LEAST * self._after.sum() else self._after

    @property
    def lost(self) -> float:
        """The share of the unseen samples that cannot be judged."""
        return 1.0 - float((self._after & self.known).mean())

    @property
    def _after(self) -> np.ndarray:
        after_skip = np.concatenate([np.arange(n) >= self.skip for n in self.unseen.lengths])
        return after_skip & self.unseen.observed[:, 0]

    @cached_property
    def known(self) -> np.ndarray:
        """True (N,) up to the sample of each unseen experiment whose output leaves the range of the part to fit."""
        y = self.estimation.y[self.estimation.observed[:, 0], 0]
        margin = _MARGIN * float(np.ptp(y))
        is_outside = (self.unseen.y[:, 0] < y.min() - margin) | (self.unseen.y[:, 0] > y.max() + margin)
        ends = np.cumsum(self.unseen.lengths)[:-1]
        return np.concatenate([np.cumsum(part) == 0 for part in np.split(is_outside, ends)])

    def shortened(self, samples: int) -> "Fold":
        """The same with the first part of every experiment only, about `samples` to fit and `samples` to judge."""
        estimation, unseen = (_shorten(part, samples) for part in (self.estimation, self.unseen))
        return Fold(estimation, unseen, min(self.skip, min(unseen.lengths) // 4))


def folds(data: IOData) -> tuple[Fold, Fold]:
    """The record in two parts, each fitted while the other is unseen.

    The parts are contiguous halves where both meet all levels and ends of the record, else as few interleaved blocks
    as let them; whole experiments are blocks. The input moves in both. Raises InputError for a record that cannot be
    halved so.
    """
    best: tuple[float, tuple[Fold, Fold]] | None = None
    moves, stands_still = _moves(data), False
    marks = _marks(data)
    for count in COUNTS:
        cuts = _cuts(data, count)
        lengths = [stop - start for start, stop in cuts]
        if len(cuts) < 2 or (len(cuts) > 2 and min(lengths) < _SHORTEST and len(cuts) > len(data.lengths)):
            continue
        counts = np.array([np.bincount(np.concatenate(marks[start:stop]), minlength=_SIZE) for start, stop in cuts])
        choices = _halves(lengths)
        costs = [_coverage_loss(counts, part) + _PRICE * _pieces(part, cuts, data) for part in choices]
        for k in np.argsort(costs, kind="stable")[:_CLOSE]:
            pair = _pair(_merge_blocks(data, cuts, choices[k]), _merge_blocks(data, cuts, ~choices[k]))
            if moves and not all(_moves(fold.estimation) for fold in pair):
                stands_still = True
                continue
            cost = costs[k] + float(np.mean([fold.lost for fold in pair]))
            if best is None or cost < best[0] - 1e-12:
                best = cost, pair
    if best is None and stands_still:
        raise InputError(
            f"structures are judged on a part of the {data.N} samples that they were not fitted to, and the input "
            "moves too rarely for two such parts; name a structure, a process for example, give the search more of the "
            "record (qpal identify --split 0.7), or record more changes"
        )
    if best is None:
        raise InputError(f"the record has {data.N} samples in {len(data.lengths)} experiment(s); give a longer one")
    return best[1]


def folds_of_other_kinds(data: IOData) -> tuple[Fold, ...]:
    """Two folds for each of three kinds: blocks of low and of high level, of slow and of fast input, of either end.

    The level is the deviation of the input within a block, its rate that of the input's steps by the level, and the end
    the mean of the output. Raises InputError for a record that is too short to be halved.
    """
    count = max(2, min(max(COUNTS), data.N // _SHORTEST))
    cuts = _cuts(data, count)
    if len(cuts) < 2:
        raise InputError(f"the record has {data.N} samples in {len(data.lengths)} experiment(s); give a longer one")
    blocks = [data.select(start, stop) for start, stop in cuts]
    level = np.array([np.std(b.u[:, 0]) for b in blocks])
    steps = np.array([np.std(np.diff(b.u[:, 0])) for b in blocks])
    rate, end = steps / np.maximum(level, 1e-9 * level.max()), np.array([np.mean(b.y[:, 0]) for b in blocks])
    kinds: list[Fold] = []
    for value in (level, rate, end):
        is_low = np.zeros(len(cuts), dtype=bool)
        is_low[np.argsort(value, kind="stable")[: len(cuts) // 2]] = True
        kinds += _pair(_merge_blocks(data, cuts, is_low), _merge_blocks(data, cuts, ~is_low))
    return tuple(kinds)


def _moves(data: IOData) -> bool:
    return any(np.ptp(e.u, axis=0).any() for e in data.experiments)


def _pair(first: IOData, second: IOData) -> tuple[Fold, Fold]:
    return Fold(first, second, _skip(second)), Fold(second, first, _skip(first))


_SIZE = 2 * _BINS + _CELLS**2


def _marks(data: IOData) -> np.ndarray:
    """The bins (N, 3) that each sample meets: of the input, of the output, and of both in their plane."""
    places = []
    for x in (data.u[:, 0], data.y[:, 0]):
        places.append((x - x.min()) / max(float(np.ptp(x)), 1e-300))
    fine = [np.minimum((p * _BINS).astype(int), _BINS - 1) for p in places]
    rough = [np.minimum((p * _CELLS).astype(int), _CELLS - 1) for p in places]
    return np.column_stack([fine[0], _BINS + fine[1], 2 * _BINS + _CELLS * rough[0] + rough[1]])


def _coverage_loss(counts: np.ndarray, part: np.ndarray) -> float:
    """The share of what either part shows and the other hardly does, for the samples met (blocks, bins)."""
    first_counts, second_counts = counts[part].sum(axis=0), counts[~part].sum(axis=0)
    total = first_counts + second_counts
    scarce = np.minimum(first_counts, second_counts) < 0.1 * total
    # By bins as well as by samples: an end that is met once is an end.
    groups = (slice(0, _BINS), slice(_BINS, 2 * _BINS), slice(2 * _BINS, _SIZE))
    shares = []
    for g in groups:
        bins, samples = total[g] > 0, total[g].sum()
        shares += [float((scarce[g] & bins).sum() / bins.sum()), float(total[g][scarce[g]].sum() / samples)]
    return float(np.mean(shares))


def _cuts(data: IOData, count: int) -> list[tuple[int, int]]:
    """Blocks of nearly equal length, at least one for each experiment.

    The input before a block is taken for its first one (see `Process`), so a block begins where the input has stood
    still for longest: what a delay still holds there is a wrong beginning otherwise, which extra parameters would fit.
    """
    blocks, begin, stood = [], 0, _stood_still(data)
    for n in data.lengths:
        block_count = max(1, round(count * n / data.N))
        edges = [begin + round(k * n / block_count) for k in range(block_count + 1)]
        reach = int(_SHIFT * n / block_count)
        edges[1:-1] = [_border(stood, middle, reach) for middle in edges[1:-1]]
        blocks += [(a, b) for a, b in itertools.pairwise(edges) if b - a >= 2]
        begin += n
    return blocks


def _border(stood: np.ndarray, middle: int, reach: int) -> int:
    """The sample around `middle` before which the input has stood still for longest, of equal ones the nearest."""
    return max(range(middle - reach, middle + reach + 1), key=lambda k: (stood[k], -abs(k - middle)))


def _stood_still(data: IOData) -> np.ndarray:
    """For how many samples (N,) each input has been what it is."""
    number = np.arange(data.N)
    changes = np.ones(data.N, dtype=bool)
    changes[1:] = (np.diff(data.u, axis=0) != 0.0).any(axis=1)
    return number - np.maximum.accumulate(np.where(changes, number, 0))


def _halves(lengths: list[int]) -> list[np.ndarray]:
    """Every choice of blocks, as masks (blocks,), that leaves enough samples on both sides; the first block is in."""
    masks = []
    total = sum(lengths)
    if len(lengths) > max(COUNTS):  # many experiments: every other one
        return [np.arange(len(lengths)) % 2 == 0]
    for choice in itertools.product((True, False), repeat=len(lengths) - 1):
        part = np.array([True, *choice])
        share = float(np.sum(np.array(lengths)[part])) / total
        if _BALANCE <= share <= 1.0 - _BALANCE:
            masks.append(part)
    return masks


def _pieces(part: np.ndarray, cuts: list[tuple[int, int]], data: IOData) -> int:
    return len(_join_blocks(data, cuts, part)) + len(_join_blocks(data, cuts, ~part))


def _join_blocks(data: IOData, cuts: list[tuple[int, int]], part: np.ndarray) -> list[tuple[int, int]]:
    """The chosen blocks; neighbours of one experiment become one piece."""
    ends = set(np.cumsum(data.lengths).tolist())
    pieces: list[tuple[int, int]] = []
    for (start, stop), is_chosen in zip(cuts, part, strict=True):
        if not is_chosen:
            continue
        if pieces and pieces[-1][1] == start and start not in ends:
            pieces[-1] = pieces[-1][0], stop
        else:
            pieces.append((start, stop))
    return pieces


def _merge_blocks(data: IOData, cuts: list[tuple[int, int]], part: np.ndarray) -> IOData:
    return IOData.merge(*(data.select(start, stop) for start, stop in _join_blocks(data, cuts, part)))


def _skip(data: IOData) -> int:
    """Samples that give an unseen experiment its initial state, as many as a fit uses (`Fit.n_init`)."""
    n = min(data.lengths)
    return min(max(50, min(n // 20, 1000)), n // 4)


def _shorten(data: IOData, samples: int) -> IOData:
    if samples >= data.N:
        return data
    parts = (e.select(0, max(2, round(e.N * samples / data.N))) for e in data.experiments)
    return IOData.merge(*parts)

"""Number of units: cross-validation over blocks, in free run too, whatever the focus."""

import time
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import IOData
from sysid.nlarx.model import Nlarx
from sysid.nlarx.problem import Piece, PredictionProblem, SimulationProblem, rows
from sysid.nlarx.result import Choice
from sysid.nlarx.starts import Linear, empty_network, linear_start, network_start, runs_of
from sysid.solver.iterate import Options

RIDGES = (1e-2, 1e-4, 0.1)  # the first is tried with every size, the others with those around the best
_LADDER = (0, 1, 3, 6, 10, 15, 20)
_FOLDS = 3  # each experiment is split into this many blocks, and each block is held back in turn
_LONGEST = 3000  # samples of an experiment that the choice uses
_GAIN = 0.98  # a larger network must reduce the held-back error (rms) to below this share of the smaller one's
_VETO = 1.2  # times the least free-run error on held-back blocks, above which a size is out
_ITERATIONS = 25  # of each fit
_PATIENCE = 3  # sizes without improvement before the search for a size ends


def choices(
    model: Nlarx, data: IOData, ridges: tuple[float, ...], search: str, deadline: float = np.inf
) -> tuple[Choice, ...]:
    """Sizes with their errors, each fitted to every record without one block and judged on that block.

    After `deadline` (`time.monotonic()`) no further size is tried.
    """
    folds = _folds(model, data)
    Phi, y = rows(model, Piece.of(data))
    empty = empty_network(model, Phi)
    linear = np.column_stack([np.ones(len(y)), Phi])
    exact = np.ptp(y - linear @ np.linalg.lstsq(linear, y, rcond=None)[0]) <= 1e-9 * np.ptp(y)
    max_units = 0 if exact or not empty.m else min(_LADDER[-1], (len(y) - linear.shape[1]) // (2 * (empty.m + 2)))
    tried_sizes: list[Choice] = []
    if max_units <= 0 or not folds:
        return (Choice(max(max_units, 0) and network_start(empty, Phi, y)[0].units, ridges[0], 0.0, 0.0),)
    judges = [_Judge.of(model, *fold, search, deadline) for fold in folds]
    sizes = [k for k in _LADDER if k <= max_units]
    for ridge in ridges:
        best, fruitless = (np.inf, np.inf), 0
        for units in sizes:
            step, free = np.sqrt(np.mean([judge.errors(units, ridge) for judge in judges], axis=0))
            tried_sizes.append(Choice(units, ridge, float(step if model.focus == "prediction" else free), float(free)))
            better = step < _GAIN * best[0] or free < _GAIN * best[1]
            fruitless, best = 0 if better else fruitless + 1, (min(step, best[0]), min(free, best[1]))
            # The first units may gain nothing where several do; beyond some that gain, fewer need to be tried.
            if fruitless >= _PATIENCE - bool(choose_size(tuple(tried_sizes)).units) or time.monotonic() > deadline:
                break
        units = choose_size(tuple(tried_sizes)).units  # of another ridge, if this one's sizes proved to run away
        sizes = sizes[sizes.index(units) :][:2] if units in sizes else [units]  # another ridge may allow one size more
        if time.monotonic() > deadline:
            break
    return tuple(tried_sizes)


def choose_size(sizes: tuple[Choice, ...]) -> Choice:
    """The smallest size whose error is as close to the least error as `_GAIN` requires.

    Sizes whose free run on held-back blocks is far above the least one are out: one step ahead, a network may predict
    well and yet run away from the plant.
    """
    runs = min(c.free for c in sizes)
    stable_sizes = [c for c in sizes if c.free <= _VETO * runs] if np.isfinite(runs) else list(sizes)
    least = min(c.error for c in stable_sizes)
    close_sizes = [c for c in stable_sizes if c.error <= least / _GAIN] or stable_sizes[:1]
    return min(close_sizes, key=lambda c: (c.units, c.error))


@dataclass(frozen=True)
class _Judge:
    """A record without one block, and that block; the linear model with the least free-run error is fitted once."""

    model: Nlarx
    estimation: IOData
    held: IOData
    search: str
    deadline: float
    linear: Linear

    @classmethod
    def of(cls, model: Nlarx, estimation: IOData, validation: IOData, search: str, deadline: float) -> "_Judge":
        return cls(model, estimation, validation, search, deadline, linear_start(model, estimation))

    def errors(self, units: int, ridge: float) -> tuple[float, float]:
        """Mean squares of the errors on the block, one step ahead and in free run; infinite where it diverges."""
        options = Options(max_iterations=_ITERATIONS, deadline=self.deadline)
        model = replace(self.model, units=units)
        runs = runs_of(model, self.estimation, self.search, 1, 0, options, ridge, self.linear, leaders=1)
        run = min(runs, key=lambda r: (not r.ended, r.loss))
        pieces = Piece.of(self.held)
        step = PredictionProblem(run.network, *rows(self.model, pieces)).residual(run.outcome.p)
        free = SimulationProblem(run.network, pieces, self.model.lag).residual(run.outcome.p)
        return tuple(np.inf if e is None else float(np.mean(e**2)) for e in (step, free))  # type: ignore[return-value]


def _folds(model: Nlarx, data: IOData) -> list[tuple[IOData, IOData]]:
    """Records without a block, and that block; the block starts with the lags that its first output needs."""
    folds, shortest = [], 2 * (model.lag + 2)
    for k in range(_FOLDS):
        estimation_parts, held_parts = [], []
        for e in data.experiments:
            N = min(e.N, _LONGEST)
            start, stop = round(k * N / _FOLDS), round((k + 1) * N / _FOLDS)
            if start >= shortest:
                estimation_parts.append(e.select(0, start))
            if N - stop >= shortest:
                estimation_parts.append(e.select(stop, N))
            if stop - start >= shortest:
                held_parts.append(e.select(max(start - model.lag, 0), stop))
        if estimation_parts and held_parts:
            folds.append((IOData.merge(*estimation_parts), IOData.merge(*held_parts)))
    return folds

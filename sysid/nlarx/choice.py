"""Number of units: generalised cross-validation gives the maximum, cross-validation over blocks the choice."""

import time
from dataclasses import replace

import numpy as np

from sysid.data.record import IOData
from sysid.nlarx.model import Nlarx
from sysid.nlarx.problem import AnyProblem, Piece, PredictionProblem, SimulationProblem, rows
from sysid.nlarx.result import Choice
from sysid.nlarx.runs import runs_of
from sysid.nlarx.start import empty_network, network_start
from sysid.solver.iterate import Options

RIDGES = (1e-4, 0.1)
_LADDER = (0, 1, 2, 3, 5, 8, 12, 20)
_FOLDS = 3  # each experiment is split into this many blocks, and each block is held back in turn
_LONGEST = 6000  # samples of an experiment that the choice uses
_GAIN = 0.98  # a larger network must reduce the held-back error (rms) to below this share of the smaller one's
_AT_LEAST = 8  # units that a simulation focus may always try, whatever one-step cross-validation gives
_PATIENCE = 2  # sizes without improvement before the search for a size ends


def choices(
    model: Nlarx, data: IOData, ridges: tuple[float, ...], search: str, deadline: float = np.inf
) -> tuple[Choice, ...]:
    """Sizes up to the maximum of generalised cross-validation, each fitted to every record without one block.

    After `deadline` (`time.monotonic()`) no further size is tried.
    """
    folds = _folds(model, data)
    Phi, y = rows(model, Piece.of(data))
    empty = empty_network(model, Phi)
    most = network_start(empty, Phi, y)[0].units
    linear = np.column_stack([np.ones(len(y)), Phi])
    exact = np.ptp(y - linear @ np.linalg.lstsq(linear, y, rcond=None)[0]) <= 1e-9 * np.ptp(y)
    if model.focus == "simulation" and empty.m and not exact:
        # The noise hides a slow nonlinearity one step ahead; in free run its effect accumulates and becomes visible.
        most = max(most, _AT_LEAST)
    found: list[Choice] = []
    if not most or not folds:
        return (Choice(most, ridges[0], 0.0),)
    sizes = sorted({*(k for k in _LADDER if k < most), most})
    for ridge in ridges:
        best, fruitless = np.inf, 0
        for units in sizes:
            sized = replace(model, units=units)
            error = float(np.sqrt(np.mean([_held_back(sized, *fold, ridge, search, deadline) ** 2 for fold in folds])))
            found.append(Choice(units, ridge, error))
            fruitless = 0 if error < _GAIN * best else fruitless + 1
            best = min(best, error)
            if fruitless >= _PATIENCE or time.monotonic() > deadline:
                break
        k = sizes.index(preferred(tuple(found)).units)
        sizes = sizes[k : k + 1 + _PATIENCE]  # another ridge may allow one or two more sizes
    return tuple(found)


def preferred(tried: tuple[Choice, ...]) -> Choice:
    """The smallest size whose error is as close to the least error as `_GAIN` requires."""
    least = min(c.error for c in tried)
    near = [c for c in tried if c.error <= least / _GAIN] or [tried[0]]
    return min(near, key=lambda c: (c.units, c.error))


def _held_back(model: Nlarx, estimation: IOData, held: IOData, ridge: float, search: str, deadline: float) -> float:
    """rms error on `held` of a model fitted to `estimation`."""
    options = Options(max_iterations=30, deadline=deadline)
    run = min(runs_of(model, estimation, search, 1, 0, options, ridge), key=lambda r: (not r.ended, r.loss))
    pieces = Piece.of(held)
    judge: AnyProblem = SimulationProblem(run.network, pieces, model.lag)
    if model.focus == "prediction":
        judge = PredictionProblem(run.network, *rows(model, pieces))
    e = judge.residual(run.outcome.p)
    return np.inf if e is None else float(np.sqrt(np.mean(e**2)))


def _folds(model: Nlarx, data: IOData) -> list[tuple[IOData, IOData]]:
    """Records without a block, and that block; the block starts with the lags that its first output needs."""
    found, shortest = [], 2 * (model.lag + 2)
    for k in range(_FOLDS):
        kept, held = [], []
        for e in data.experiments:
            N = min(e.N, _LONGEST)
            start, stop = round(k * N / _FOLDS), round((k + 1) * N / _FOLDS)
            if start >= shortest:
                kept.append(e.select(0, start))
            if N - stop >= shortest:
                kept.append(e.select(stop, N))
            if stop - start >= shortest:
                held.append(e.select(max(start - model.lag, 0), stop))
        if kept and held:
            found.append((IOData.merge(*kept), IOData.merge(*held)))
    return found

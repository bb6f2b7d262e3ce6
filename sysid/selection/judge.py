"""One candidate fitted to one part of a record and run freely over the other, and vice versa."""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.objective import Objective
from sysid.estimation.result import Fit
from sysid.estimation.starts import starts as make_starts
from sysid.fitting import fit as fit_model
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe
from sysid.nlarx.result import NlarxFit
from sysid.selection.folds import Fold
from sysid.selection.table import BLOCKS, Row, mean_log
from sysid.solver.iterate import Options

AnyFit = Fit | NlarxFit


@dataclass(frozen=True)
class Effort:
    """What one candidate gets: its starts, its iterations, and a limit in seconds for each of its fits."""

    starts: int
    iterations: int
    seconds: float = np.inf


@dataclass(frozen=True)
class Job:
    """One candidate to judge; after `deadline` (`time.time()`) it is left out, and its fits end early."""

    candidate: Recipe
    folds: tuple[Fold, ...]
    effort: Effort
    search: str
    seed: int
    number: int
    whole: bool
    deadline: float = np.inf


_LOOK = Objective(knots=0)  # ten break points: a look ranks candidates, and finer maps cost three times the search
_APART = 1.5  # times the residual of the other part, from which a fit gets more starts
_MORE = (4, 8)  # times the starts


def fitted(c: Recipe, data: IOData, search: str, seed: int, effort: Effort, deadline: float = np.inf) -> AnyFit:
    """The candidate fitted to a record that is on its own scale."""
    model = c.model_of(data)
    _compile(model)
    options = Options(max_iterations=effort.iterations, max_seconds=effort.seconds, deadline=deadline)
    method = c.auto if search == "auto" else search
    starts = max(effort.starts, c.least_starts)
    if starts == 1 and isinstance(model, Chain):  # a look: the first own start, without the portfolio's screening
        point = np.array(make_starts(model, data, 1, seed))
        return fit_chain(model, data, search=method, seed=seed, options=options, start=point, objective=_LOOK)
    fit = fit_model(model, data, search=method, starts=starts, seed=seed, options=options)
    if c.least_starts == 1 or len(data.lengths) == 1 or not isinstance(model, Chain):
        return fit
    # Several experiments, with an initial state each, have more local optima than the longest of them alone.
    longest = max(data.experiments, key=lambda e: e.N)
    try:
        single_fit = fit_chain(model, longest, search=method, starts=starts, seed=seed, options=options)
        refit = fit_chain(model, data, search=method, start=single_fit, options=options)
    except InputError:
        return fit
    return refit if refit.criteria.loss < fit.criteria.loss else fit


def _compile(model: Any) -> None:
    """Compile the kernels of a chain on a short input: a machine that never ran them takes seconds, and a look at one
    candidate has little more."""
    x = np.linspace(-1.0, 1.0, 4)
    for block in model.blocks if isinstance(model, Chain) else ():
        if block.channels == (1, 1):
            b = block.scaled(x[:, None], x[:, None])
            theta = b.start(x)
            b.propagate(theta, x, np.zeros((len(x), len(theta))), 0)
            b.propagate(theta, x, np.empty((len(x), 0)), 0)


def _fits(job: Job, deadline: float) -> list[AnyFit]:
    """The fits to all parts. Their residuals should be alike, as the plant is the same: a fit whose residual is far
    above the least one ended in a poor optimum and gets more starts.
    """
    c, data = job.candidate, [job.candidate.scale(fold.estimation) for fold in job.folds]
    start_time = time.monotonic()
    fits = [fitted(c, part, job.search, job.seed, job.effort, deadline) for part in data]
    if job.effort.starts < 2:
        return fits
    for factor in _MORE:
        for k, part in enumerate(data):
            least = min(fit.criteria.mse for fit in fits)
            if fits[k].criteria.mse <= _APART**2 * least or time.monotonic() > start_time + job.effort.seconds:
                continue
            effort = replace(job.effort, starts=factor * job.effort.starts)
            refit = fitted(c, part, job.search, job.seed + factor, effort, deadline)
            if refit.criteria.loss < fits[k].criteria.loss:
                fits[k] = refit
    return fits


def judge(job: Job) -> Row | None:
    """Free-run errors of one candidate on the unseen part of every fold; None after the deadline."""
    remaining = job.deadline - time.time()
    if remaining < 0:
        return None
    deadline = time.monotonic() + remaining
    c, parts, spread, thetas = job.candidate, [], 0.0, []
    failed_row = Row(c, -np.inf, 0, job.number, np.full(BLOCKS, np.inf), False, whole=job.whole)
    d, converged, count = 0, True, 0
    try:
        fits = _fits(job, deadline)
        runs = [np.ravel(fit.simulate(c.scale(f.unseen), f.skip)) for fit, f in zip(fits, job.folds, strict=True)]
    except InputError as error:  # too short for these orders, no valid start: not a usable structure here
        return replace(failed_row, why=str(error))
    for fit, run, fold in zip(fits, runs, job.folds, strict=True):
        estimation, unseen = c.scale(fold.estimation), c.scale(fold.unseen)
        keep = fold.judged
        y = unseen.y[keep, 0]
        with np.errstate(over="ignore", invalid="ignore"):
            squares = (y - run[keep]) ** 2
        d, converged = _size(fit, estimation), converged and fit.stop.converged
        parts.append(np.array([block.mean() for block in np.array_split(squares, BLOCKS // len(job.folds))]))
        spread, count = spread + float(np.sum((y - y.mean()) ** 2)), count + len(y)
        thetas.append(fit.theta)
    errors = np.concatenate(parts)
    errors = np.where(np.isfinite(errors), errors, np.inf)
    mean = float(errors.mean())
    percent = 100.0 * (1.0 - np.sqrt(mean * count / spread)) if np.isfinite(mean) and spread > 0 else -np.inf
    reason = "" if np.isfinite(percent) else "its free run on unseen data diverges"
    return replace(
        failed_row, fit_percent=percent, d=d, errors=errors, converged=converged, why=reason, thetas=tuple(thetas)
    )


def judge_by_kind(job: Job) -> np.ndarray | None:
    """Mean logarithm of squared free-run errors (len(folds),) on the unseen part of each fold; None after the deadline.

    Infinite where a fit or its run fails.
    """
    c, means = job.candidate, []
    for fold in job.folds:
        remaining = job.deadline - time.time()
        if remaining < 0:
            return None
        try:
            fit = fitted(c, c.scale(fold.estimation), job.search, job.seed, job.effort, time.monotonic() + remaining)
            run = np.ravel(fit.simulate(c.scale(fold.unseen), fold.skip))
        except InputError:
            means.append(np.inf)
            continue
        keep = fold.judged
        with np.errstate(over="ignore", invalid="ignore"):
            squares = (c.scale(fold.unseen).y[keep, 0] - run[keep]) ** 2
        means.append(mean_log([block.mean() for block in np.array_split(squares, BLOCKS // 2)]))
    return np.array(means)


def _size(fit: AnyFit, data: IOData) -> int:
    """Parameters of a fit to one experiment: blocks of a record add initial states that its model does not have."""
    initial_count = int((fit.model.free & fit.model.initial).sum()) if isinstance(fit, Fit) else 0
    return fit.criteria.d - initial_count * (len(data.lengths) - 1)


def unchanged(row: Row) -> dict[str, Any]:
    """A row for a journal; `from_journal` reads it."""
    return {
        "fit": row.fit_percent,
        "d": row.d,
        "errors": row.errors.tolist(),
        "converged": row.converged,
        "whole": row.whole,
        "why": row.why,
        "thetas": [theta.tolist() for theta in row.thetas],
    }


def from_journal(c: Recipe, number: int, entry: dict[str, Any]) -> Row:
    """The row that `unchanged` wrote."""
    thetas = tuple(np.array(theta) for theta in entry["thetas"])
    values = entry["fit"], entry["d"], number, np.array(entry["errors"]), entry["converged"]
    return Row(c, *values, whole=entry["whole"], why=entry["why"], thetas=thetas)

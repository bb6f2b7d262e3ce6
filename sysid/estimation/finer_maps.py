"""A stage after the search: maps with many break points, whose changes of slope have a prior that the record chooses.

A map of few free break points cannot follow a smooth curve, and one of many follows the noise. Here every change of
slope k_i has a Cauchy distribution of one width tau for a map: k_i ~ N(0, 1 / l_i), l_i ~ Gamma(1 / 2, tau^2 / 2). Most
changes are then almost zero and a few are as large as the record wants: a saturation keeps its two corners, and a
smooth curve bends a little everywhere. Widths are those of the largest marginal likelihood, by expectation and
maximisation around the linearised model (Tipping 2001, Journal of Machine Learning Research 1). The likelihood takes
the errors for white, at the level that gives the parameters of the maps the variance that the errors' own colour gives
them (Chandler and Bate 2007, Biometrika 94): slow errors, and those of a model that lacks something, say less than as
many white ones.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from sysid.block.block import Block
from sysid.blocks import PiecewiseLinear
from sysid.data.record import IOData
from sysid.estimation.noise_model import noise_model
from sysid.estimation.normal import Normal
from sysid.estimation.objective import Objective
from sysid.estimation.prior import Prior
from sysid.estimation.problem import ChainProblem
from sysid.estimation.search import SearchContext, SearchResult
from sysid.model.chain import Chain
from sysid.solver.linearisation import Linearisation

_ROUNDS, _ITERATIONS, _UPDATES = 8, 5, 80  # linearisations, steps of the search in each, and updates of the widths
_LAST = 200  # steps with the last widths: the curves of weak priors end slowly
_STEADY = 0.02  # largest change of a log precision in an update that ends them
_SETTLED = 0.1  # the same between two rounds
_UNSETTLED = 2  # rounds before that counts
_NARROWEST = 1e-9  # tau^2, by the square of the range of the map's slopes
_NOISELESS = 1e-30  # the least noise, by the mean square of the errors
_JITTER = 1e-11  # of a diagonal of ones: directions that neither the record nor the prior holds


@dataclass(frozen=True)
class _Maps:
    """Changes of slope as rows (k, P) of theta, by the range of their map's slopes, and the rows of each map."""

    rows: np.ndarray
    groups: tuple[slice, ...]
    places: tuple[int, ...]  # of each map in the chain

    def prior(self, problem: ChainProblem, thetas: np.ndarray) -> Prior:
        """The prior around thetas (E, P) with weights of 1, which the scale of a map before a filter does not change.

        The filter behind undoes that scale. Changes of slope count by the deviation of the map's output over all
        experiments, so that a smaller scale is not a smoother map.
        """
        chain, rows, theta = problem.chain, self.rows.copy(), thetas[0]
        changes = rows @ theta
        inner = [chain.signals(each, record.u) for each, record in zip(thetas, problem.records, strict=True)]
        for k, group in zip(self.places, self.groups, strict=True):
            if k == len(chain.blocks) - 1:
                continue
            block, part = chain.blocks[k], chain.index(chain.blocks[k])
            x = np.concatenate([signals[k] for signals in inner])
            f = block.output(theta[part], x)
            f = f - f.mean()
            if np.any(f):  # one hat at a time: all of a long record would not stay in memory
                slope = np.array([block.output(hat, x) @ f for hat in np.eye(block.n_parameters)])
                rows[group, part] -= np.outer(changes[group], slope / float(f @ f))
        return Prior(rows, rows @ theta - changes, np.ones(len(rows)), chosen=True)


def finer_maps(
    model: Chain,
    data: IOData,
    normal: Normal,
    result: SearchResult,
    context: SearchContext,
    weights: np.ndarray | None = None,
) -> tuple[Chain, Normal, SearchResult]:
    """The model with finer maps, its normal units, and the end of its search there; as given where it has no such map.

    `context` and `result` are those of `model` in the units `normal`; `weights` (k,) is the `smoothing` of a fit that
    goes on.
    """
    thetas = normal.restore(model, data, result.problem, result.outcome)[0].theta0
    finer, thetas = _finer_chain(model, thetas, data, context.objective.knots)
    if not _maps(finer, thetas[0]).groups:
        return model, normal, result
    corners = not has_finer_maps(model)
    return finer, *search_finer(finer, thetas, data, normal, result, context, weights, corners)


def search_finer(
    chain: Chain,
    thetas: np.ndarray,
    data: IOData,
    normal: Normal,
    result: SearchResult,
    context: SearchContext,
    weights: np.ndarray | None,
    corners: bool = False,
) -> tuple[Normal, SearchResult]:
    """The search goes on from thetas (K, P) of another chain, with the prior of its finer maps where it has some.

    `result` is the search before, in the units `normal`, and `weights` (k,) its `smoothing` of the maps that stay.
    `corners` where they still have those of the search before. Returns the normal units of the chain too.
    """
    fine_normal = Normal.choose(chain, data, context.objective)
    fine, thetas = fine_normal.chain, np.linalg.solve(fine_normal.M, (thetas - fine_normal.m).T).T
    threshold = result.problem.huber_threshold * normal.size / fine_normal.size
    context = replace(context, model=fine, data=fine_normal.data, unit=fine_normal.size, huber_threshold=threshold)
    maps = _maps(fine, thetas[0])
    problem = replace(context.problem(thetas), moving=fine.free & ~held_scales(fine, thetas[0]))
    costs = tuple(c * (normal.size / fine_normal.size) ** 2 for c in result.costs)
    result = replace(result, problem=problem, outcome=replace(result.outcome, p=problem.start), costs=costs)
    if not maps.groups:
        end = context.iterate(problem, problem.start, context.options)
        return fine_normal, replace(result, outcome=result.outcome.then(end))
    precisions = _Precisions(maps, corners)
    if weights is not None and len(weights) == len(maps.rows):
        saved = Prior(slope_changes(chain), np.zeros(len(weights)), weights, chosen=True)
        there = saved.moved(np.linalg.inv(fine_normal.M), np.zeros(len(thetas[0])), 1.0 / fine_normal.size)
        precisions.begin(_weights_of(maps.rows, there))
    return fine_normal, _fit_with_prior(context, result, maps, precisions)


def becomes_finer(model: Chain, objective: Objective) -> bool:
    """Whether all maps of the chain whose break points may move end with many places."""
    maps = [block for block in model.blocks if any(isinstance(part, PiecewiseLinear) for _, part in block.parts())]
    ends = [isinstance(b, PiecewiseLinear) and b.free_knots and b.knots is None and may_change(model, b) for b in maps]
    return bool(objective.knots and not objective.ridge and maps and all(ends))


def has_finer_maps(chain: Chain) -> bool:
    """Whether maps of the chain have the many places of a former fit, and so need their prior."""
    return any(len(block.slope_changes()) for block in chain.blocks)


def on_break_points(model: Chain, points: list[np.ndarray], data: IOData, knots: int) -> tuple[Chain, list[np.ndarray]]:
    """The chain and its points theta (P,) with many break points in place of the shapes that a former fit has found."""
    if not knots or model.asked == model.blocks or has_finer_maps(model):
        return model, points
    finer = _finer_chain(model, np.tile(points[0], (len(data.experiments), 1)), data, knots)[0]
    pairs = list(zip(model.blocks, finer.blocks, strict=True))

    def moved(theta: np.ndarray) -> np.ndarray:
        """The same curves at the places of the finer maps."""
        parts = [model.part(theta, old) for old, _ in pairs]
        for k, (old, new) in enumerate(pairs):
            if isinstance(new, PiecewiseLinear) and new != old:
                parts[k] = old.output(parts[k], np.array(new.at))
        return np.concatenate(parts)

    return finer, [moved(theta) for theta in points]


def slope_changes(chain: Chain) -> np.ndarray:
    """Rows (k, P): rows theta are the changes of slope of all finer maps, which are free."""
    rows = [np.empty((0, len(chain.names)))]
    for block in chain.blocks:
        part, changes = chain.index(block), block.slope_changes()
        if len(changes) and chain.free[part].all():
            wide = np.zeros((len(changes), len(chain.names)))
            wide[:, part] = changes
            rows.append(wide)
    return np.concatenate(rows)


def smoothing(chain: Chain, prior: Prior | None) -> np.ndarray | None:
    """The weights (k,) that a chosen prior gives the changes of slope of the chain; None without such a prior."""
    if prior is None or not prior.chosen or not has_finer_maps(chain):
        return None
    return _weights_of(slope_changes(chain), prior)


def _weights_of(rows: np.ndarray, prior: Prior) -> np.ndarray:
    """The weights (k,) of a prior for the same changes of slope in other sizes, also of maps that are turned round."""
    weighted = prior.weight[:, None] * prior.rows
    first = np.argmax(np.abs(weighted) > 1e-9 * np.abs(weighted).max(axis=1, keepdims=True), axis=1)
    return np.linalg.norm(weighted[np.argsort(first)], axis=1) / np.linalg.norm(rows, axis=1)


def _finer_chain(model: Chain, thetas: np.ndarray, data: IOData, knots: int) -> tuple[Chain, np.ndarray]:
    """The chain with finer maps, and thetas (K, P) with the same output; only maps of free parameters change."""
    runs = [model.signals(theta, e.u) for theta, e in zip(thetas, data.experiments, strict=True)]
    blocks, parts = [], []
    for k, block in enumerate(model.blocks):
        part, change = model.index(block), None
        if may_change(model, block):
            x = np.concatenate([run[k].reshape(-1) for run in runs])
            change = block.finer(thetas[0, part], x, knots)
        blocks.append(block if change is None else change[0])
        parts.append(thetas[:, part] if change is None else np.tile(change[1], (len(thetas), 1)))
    return replace(model, blocks=tuple(blocks)), np.hstack(parts)


def may_change(model: Chain, block: Block) -> bool:
    """Whether the block has one channel and its parameters are free, without bounds of the user's."""
    part = model.index(block)
    limited = any(name in model.bounds for name in model.names[part])
    return block.channels == (1, 1) and bool(model.free[part].all()) and not limited


def _maps(chain: Chain, theta: np.ndarray) -> _Maps:
    """The changes of slope of all maps at fixed places, which are free."""
    rows, groups, count, places = [np.empty((0, len(theta)))], [], 0, list[int]()
    for k, block in enumerate(chain.blocks):
        changes = block.slope_changes()
        if not len(changes) or not chain.free[chain.index(block)].all():
            continue
        part = chain.part(theta, block)
        slopes = np.cumsum(changes @ part)
        wide = np.zeros((len(changes), len(theta)))
        wide[:, chain.index(block)] = changes / (float(np.ptp(slopes)) or 1.0)
        rows.append(wide)
        groups.append(slice(count, count + len(changes)))
        places.append(k)
        count += len(changes)
    return _Maps(np.concatenate(rows), tuple(groups), tuple(places))


def held_scales(chain: Chain, theta: np.ndarray) -> np.ndarray:
    """True (P,) for one value of each map before a filter, whose scale is redundant."""
    held = np.zeros(len(theta), dtype=bool)
    for block in chain.blocks[:-1]:
        if isinstance(block, PiecewiseLinear) and len(block.slope_changes()):
            held[chain.index(block).start + int(np.argmax(np.abs(chain.part(theta, block))))] = True
    return held


def _fit_with_prior(
    context: SearchContext, result: SearchResult, maps: _Maps, precisions: "_Precisions"
) -> SearchResult:
    """The search goes on, in rounds of new precisions for the linearised model and a few steps with these."""
    problem, outcome = result.problem, result.outcome
    n = int(problem.moving.sum())
    basis = np.zeros((problem.theta0.shape[1], len(problem.start)))
    basis[:, :n] = problem.chain.basis[:, problem.moving]
    lengths = [record.N for record in problem.records]
    options = replace(context.options, max_iterations=min(_ITERATIONS, context.options.max_iterations))
    for _ in range(_ROUNDS):
        bare = problem.bare
        thetas = problem.thetas(outcome.p)
        prior = maps.prior(problem, thetas)
        rows = prior.rows @ basis
        lin = bare.compact(outcome.p)
        if lin is None:
            e, J = bare.linearise(outcome.p)
            lin = Linearisation.of(e, J)
            if precisions.rounds <= _UNSETTLED:
                precisions.noise = noise_model(e, J, lengths).level(J[:, np.any(rows, axis=0)], lengths)
        elif precisions.rounds <= _UNSETTLED:
            precisions.noise = (lin.cost - float(lin.z @ lin.z)) / lin.N
        settled = precisions.update(lin, maps.rows @ thetas[0], rows)
        weight = np.sqrt(precisions.precision * precisions.noise)
        candidate = replace(problem, prior=replace(prior, weight=weight), scratch={})
        end = context.iterate(candidate, outcome.p, options)
        if not np.isfinite(end.cost):
            break
        problem, outcome = candidate, outcome.then(end)
        if settled or context.out_of_time:
            break
    if not outcome.stop.converged:
        last = replace(options, max_iterations=min(_LAST, context.options.max_iterations))
        outcome = outcome.then(context.iterate(problem, outcome.p, last))
    if problem.prior is not None:
        weight = problem.prior.weight
        problem = replace(problem, prior=Prior(maps.rows, np.zeros(len(weight)), weight, chosen=True), scratch={})
    return replace(result, problem=problem, outcome=outcome)


class _Precisions:
    """Precisions (k,) of the changes of slope for noise of the variance `noise`, by expectation and maximisation."""

    def __init__(self, maps: _Maps, corners: bool) -> None:
        """`corners` where the maps have those of an earlier search."""
        self.groups, self.corners, self.rounds = maps.groups, corners, 0
        self.precision: np.ndarray = np.empty(0)
        self.weight: np.ndarray = np.empty(0)
        self.noise = 0.0

    def begin(self, weight: np.ndarray) -> None:
        """From the weights (k,) of a fit that goes on, which are deviations of the noise by those of the prior."""
        self.weight, self.rounds = weight, _UNSETTLED

    def update(self, lin: Linearisation, changes: np.ndarray, rows: np.ndarray) -> bool:
        """New values around a linearisation without prior, where the changes of slope are `changes` (k,).

        `rows` (k, n) give the changes of slope in the search's directions. Returns whether the values have settled. The
        first time there is one precision for a map, which removes corners that an earlier search has left and the
        record does not want.
        """
        gaussian = self.corners and self.rounds == 0
        self.rows, self.rounds = rows, self.rounds + 1
        self.noise = max(self.noise, _NOISELESS * lin.cost / lin.N)
        if not len(self.precision):
            self.precision = self.weight**2 / self.noise
            if not len(self.weight):
                pieces = [np.full(g.stop - g.start, 1.0 / _square(changes[g])) for g in self.groups]
                self.precision = np.concatenate(pieces)
        before = self.precision
        for _ in range(_UPDATES):
            delta, variance = self._posterior(lin, changes)
            square = (changes + self.rows @ delta) ** 2 + variance
            precision = np.concatenate([self._group(g, square[g], gaussian) for g in self.groups])
            step = float(np.max(np.abs(np.log(precision / self.precision))))
            self.precision = precision
            if step < _STEADY:
                break
        change = np.max(np.abs(np.log(self.precision / before)))
        return bool(self.rounds > _UNSETTLED and change < _SETTLED)

    def _group(self, group: slice, square: np.ndarray, gaussian: bool) -> np.ndarray:
        """New precisions of one map from the expected squares of its changes of slope."""
        if gaussian:
            return np.full(len(square), 1.0 / _square(np.sqrt(square)))
        tau2 = max(len(square) / float(np.sum(self.precision[group])), _NARROWEST)  # the maximum given the precisions
        return np.asarray(2.0 / (tau2 + square))

    def _posterior(self, lin: Linearisation, changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n,) of the step, and variance (k,) of the changes of slope."""
        weighted = self.rows * self.precision[:, None]
        H = lin.R.T @ lin.R / self.noise + self.rows.T @ weighted
        scale = np.sqrt(np.diag(H))
        scale[scale == 0.0] = 1.0
        L = cholesky(H / np.outer(scale, scale) + _JITTER * np.eye(len(H)), lower=True)
        inverse = solve_triangular(L, np.diag(1.0 / scale), lower=True)  # its square is H's inverse
        delta = inverse.T @ (inverse @ (lin.R.T @ lin.z / self.noise - weighted.T @ changes))
        variance = np.sum((inverse @ self.rows.T) ** 2, axis=0)
        return delta, variance


def _square(changes: np.ndarray) -> float:
    """Mean square of changes of slope, not below the narrowest width."""
    return max(float(np.mean(changes**2)), _NARROWEST)

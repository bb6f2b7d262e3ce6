"""The last stage: a map of many break points becomes a shape of few numbers where the record says that it has one.

A line, a parabola, a cubic, a saturation, a dead zone or both go on beyond the record as they do within it, and their
numbers mean something. A shape takes the place of the break points where BIC of the fit with it is lower by odds of 20
to 1 (Schwarz 1978, Annals of Statistics 6). Which are worth a search is seen before it (`sysid.estimation.map_shapes`).
"""

from dataclasses import replace

import numpy as np

from sysid.base.kinds import SIZE
from sysid.blocks import DeadZoneSaturation, Offset, PiecewiseLinear, TransferFunction
from sysid.blocks._shape import is_named
from sysid.data.record import IOData
from sysid.estimation.finer_maps import has_finer_maps, may_change, search_finer, smoothing
from sysid.estimation.map_shapes import SURE, Form, LocalMap, forms, promise, stands_alone
from sysid.estimation.normal import Normal
from sysid.estimation.search import SearchContext, SearchResult
from sysid.model.chain import Chain
from sysid.model.recipes import with_offset
from sysid.solver.iterate import ESTIMATE
from sysid.solver.linearisation import Linearisation

State = tuple[Chain, Normal, SearchResult]

_TRIED = 2  # searches for a map
_LEVELS = 3  # of a map that the record shows


def named_maps(model: Chain, data: IOData, normal: Normal, result: SearchResult, context: SearchContext) -> State:
    """The model, its normal units and the end of its search, with named shapes for the maps that have one.

    `context` is that of the search, in units of its own.
    """
    state = (model, normal, result)
    at_end = result.outcome.stop.converged and not np.isfinite(context.huber_threshold)
    if not context.objective.shapes or not has_finer_maps(model) or not at_end:
        return state
    bic = _bic(data, normal, result)
    while not context.out_of_time:
        better = _better(state, data, context, bic)
        if better is None:
            break
        state, bic = better
    return state if state[0] is model else _with_ranges(state, data)


def _with_ranges(state: State, data: IOData) -> State:
    """The ranges of the signals of named shapes, which the search has changed."""
    model, normal, result = state
    problem, outcome = normal.restore(model, data, result.problem, result.outcome)
    pairs = zip(problem.thetas(outcome.p), data.experiments, strict=True)
    runs = [model.signals(theta, record.u) for theta, record in pairs]
    blocks = list(model.blocks)
    for k, block in enumerate(blocks):
        if is_named(block):
            x = np.concatenate([run[k] for run in runs])
            blocks[k] = replace(block, found=(float(x.min()), float(x.max())))
    return replace(model, blocks=tuple(blocks)), normal, result


def _better(state: State, data: IOData, context: SearchContext, bic: float) -> tuple[State, float] | None:
    """The first of the most promising fits with one more named map whose BIC is lower, and that; None without one."""
    model, normal, result = state
    problem, outcome = normal.restore(model, data, result.problem, result.outcome)
    thetas = problem.thetas(outcome.p)
    if not np.all(np.abs(thetas) < SIZE):
        return None
    weights = smoothing(model, problem.prior)
    rounded = replace(context, options=replace(context.options, first_grain=ESTIMATE))  # the same on every processor
    wide = replace(problem.bare, theta0=thetas, moving=model.free, scratch={})
    lin = wide.compact(wide.start) or Linearisation.of(*wide.linearise(wide.start))
    maps = [(k, b) for k, b in enumerate(model.blocks) if isinstance(b, PiecewiseLinear) and len(b.slope_changes())]
    near = [(k, LocalMap.of(problem, thetas, lin, model.index(b), b.at)) for k, b in maps if may_change(model, b)]
    levels = [local.rank(np.eye(len(local.x))) for _, local in near]
    if min(levels, default=0) < _LEVELS:  # between two levels a record tells nothing, not even that a map is a line
        return None
    for (k, local), rank in zip(near, levels, strict=True):
        told = [(promise(form, local, k > 0), form) for form in forms(local, model.blocks[k].role)]
        for change, form in sorted(told, key=lambda each: each[0])[:_TRIED]:
            is_told = change < -SURE and form.shown and form.count < rank
            is_told = is_told and stands_alone(form, local)
            changed = _replaced(model, thetas, k, form) if is_told else None
            if changed is None or not changed[0].admissible(changed[1][0]):
                continue
            kept = None if weights is None else weights[_others(model, k)]
            trial = (changed[0], *search_finer(*changed, data, normal, result, rounded, kept))
            value = _bic(data, *trial[1:])
            if value < bic - SURE:
                return trial, value
    return None


def _bic(data: IOData, normal: Normal, result: SearchResult) -> float:
    """BIC of the plain errors, but for a constant."""
    N, e = int(data.observed.sum()), result.problem.plain.residual(result.outcome.p)
    if e is None or not np.any(e):
        return np.inf
    d = result.problem.uncertainty(result.outcome.p)[1]
    return float(N * np.log(float(e @ e) * normal.size**2) + d * np.log(N))


def _replaced(model: Chain, thetas: np.ndarray, k: int, form: Form) -> tuple[Chain, np.ndarray] | None:
    """The chain and its parameters (K, P) with the shape as block k; None where no block takes up its gain or level.

    A filter beside it takes up the gain, and what follows the level: a map of break points, else an offset behind all.
    """
    blocks, parts, theta = list(model.blocks), [thetas[:, model.index(block)] for block in model.blocks], form.theta
    is_last = k == len(blocks) - 1 or isinstance(blocks[k + 1], Offset)
    if is_last and isinstance(form.block, DeadZoneSaturation):
        theta = theta * np.repeat([1.0, form.gain], [4, 2])
    elif form.gain != 1.0:
        beside, one, gain = (k - 1 if is_last else k + 1), np.ones(1), np.array([form.gain])
        law = blocks[beside].law(*((one, gain) if is_last else (1.0 / gain, one)))
        if law is None or not may_change(model, blocks[beside]):
            return None
        parts[beside] = parts[beside] @ law.M.T
        theta = np.sort(form.gain * theta) if is_last else theta
    blocks[k], parts[k] = form.block, np.tile(theta, (len(thetas), 1))
    level = form.level if is_last else form.level / form.gain  # what follows takes the block's own output
    for j in range(k + 1, len(blocks)):
        block = blocks[j]
        if isinstance(block, PiecewiseLinear):
            blocks[j], level = replace(block, at=tuple((np.array(block.at) - level).tolist())), 0.0
        elif isinstance(block, Offset):
            parts[j], level = parts[j] + level, 0.0
        elif isinstance(block, TransferFunction):
            parts[j] = np.array([block.lowered(row, level) for row in parts[j]])
            level *= block.gain(parts[j][0])
        if not np.isfinite(level):  # behind a filter that integrates
            return None
    if len(with_offset(blocks, 1, "free")) > len(blocks):
        blocks.append(Offset(role="offset", found=True))
        parts.append(np.full((len(thetas), 1), level))
    changed = replace(model, blocks=tuple(blocks)), np.hstack(parts)
    return changed if np.all(np.abs(changed[1]) < SIZE) else None


def _others(model: Chain, k: int) -> np.ndarray:
    """True for the changes of slope of every map but block k."""
    counts = [len(block.slope_changes()) for block in model.blocks]
    return np.repeat(np.arange(len(counts)) != k, counts)

"""The last stage: a map of many break points becomes a shape of few numbers where the record says that it has one.

A line, a parabola, a cubic, a saturation, a dead zone or both go on beyond the record as they do within it, and their
numbers mean something. A shape takes the place of the break points where BIC of the fit with it is lower (Schwarz
1978, Annals of Statistics 6). Which shapes are worth a search is seen before: the fit around its end is linear in the
values of a map, and the other parameters follow these, so that a small least-squares problem tells the errors that are
left by a map of each shape.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares

from sysid.block.block import Block, StaticBlock
from sysid.blocks import (
    DeadZone,
    DeadZoneSaturation,
    Offset,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    TransferFunction,
)
from sysid.data.record import IOData
from sysid.estimation.finer_maps import has_finer_maps, may_change, search_finer, smoothing
from sysid.estimation.normal import Normal
from sysid.estimation.problem import ChainProblem
from sysid.estimation.search import SearchContext, SearchResult
from sysid.model.chain import Chain
from sysid.model.recipes import with_offset
from sysid.solver.linearisation import Linearisation

State = tuple[Chain, Normal, SearchResult]

_DEGREES = (1, 2, 3)
_PLACES = {2: 12, 4: 8}  # of the break points that are tried as corners, by how many corners a shape has
_BEGUN = 3  # of them from which the corners move
_TRIED = 2  # searches for a map
_WEAK = 1e-5  # of its size: how far a direction that the record does not show may go


@dataclass(frozen=True)
class _Local:
    """Errors of the fit near its end by the values v (m,) of one map: |z - S (v - values)|^2 + rest."""

    at: np.ndarray
    values: np.ndarray
    S: np.ndarray
    z: np.ndarray
    rest: float
    count: float  # effective number of parameters of the map

    @classmethod
    def of(cls, problem: ChainProblem, thetas: np.ndarray, lin: Linearisation, part: slice, at: np.ndarray) -> "_Local":
        """From the linearisation in all free parameters, with the prior on the others; `part` has the map's values."""
        prior, free = problem.prior, problem.chain.free
        mine = np.zeros(len(lin.z), dtype=bool)
        mine[: int(free.sum())] = np.isin(np.flatnonzero(free), np.arange(part.start, part.stop))
        size = np.linalg.norm(lin.R, axis=0)
        size[size == 0.0] = 1.0
        weak = np.diag(np.where(mine, 0.0, _WEAK * size))
        held = _held(problem.chain, thetas[0], mine) * size
        rows, own = [lin.R, weak, held / _WEAK], np.zeros((0, int(mine.sum())))
        e = [lin.z, np.zeros(len(weak) + len(held))]
        if prior is not None:
            wide = np.zeros((len(prior.weight), len(mine)))
            wide[:, : int(free.sum())] = prior.jacobian(problem.chain.basis[:, free])
            is_own = np.any(wide[:, mine], axis=1)
            rows.append(wide[~is_own])
            e.append(prior.errors(thetas[0])[~is_own])
            own = wide[is_own][:, mine]
        A = np.concatenate(rows)
        triangle = qr(np.column_stack([A[:, ~mine], A[:, mine], np.concatenate(e)]), mode="r")[0]
        m, end = int(mine.sum()), len(mine)
        S, z = triangle[end - m : end, end - m : end], triangle[end - m : end, end]
        rest = float(triangle[end, end] ** 2) + lin.cost - float(lin.z @ lin.z)
        both = np.linalg.lstsq(np.concatenate([S, own]), np.concatenate([S, 0.0 * own]), rcond=None)[0]
        return cls(at, thetas[0, part], S, z, rest, float(np.trace(both)))

    def errors(self, values: np.ndarray) -> np.ndarray:
        """z - S (v - values), (m,)."""
        return np.asarray(self.z - self.S @ (values - self.values))

    def best(self, columns: np.ndarray) -> np.ndarray:
        """The weights c (k,) of the columns (m, k) whose sum leaves the least errors."""
        return np.asarray(np.linalg.lstsq(self.S @ columns, self.z + self.S @ self.values, rcond=None)[0])


def _held(chain: Chain, theta: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """Rows (g, n) of what the other parameters do where a change of the map and of these has no effect.

    The fit around its end takes a map of no size for as good as any, as long as the filter behind can be larger.
    """
    redundant = np.linalg.solve(chain.basis, chain.gauge(theta))[chain.free]
    wide = np.zeros((redundant.shape[1], len(mine)))
    wide[:, : len(redundant)] = redundant.T
    wide[:, mine] = 0.0
    return wide


@dataclass(frozen=True)
class _Form:
    """A shape near a map, which is gain times the block's output and a level; the errors left, and what they show.

    `count` is how many of its numbers the record shows, `shown` whether it shows all corners: a limit that no sample
    passes is no limit.
    """

    block: StaticBlock
    theta: np.ndarray
    gain: float
    level: float
    errors: np.ndarray
    count: int
    shown: bool


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
    return state


def _better(state: State, data: IOData, context: SearchContext, bic: float) -> tuple[State, float] | None:
    """The first of the most promising fits with one more named map whose BIC is lower, and that; None without one."""
    model, normal, result = state
    problem, outcome = normal.restore(model, data, result.problem, result.outcome)
    thetas = problem.thetas(outcome.p)
    weights = smoothing(model, problem.prior)
    wide = replace(problem.bare, theta0=thetas, moving=model.free, scratch={})
    lin = wide.compact(wide.start) or Linearisation.of(*wide.linearise(wide.start))
    for k, block in enumerate(model.blocks):
        if not isinstance(block, PiecewiseLinear) or not len(block.slope_changes()) or not may_change(model, block):
            continue
        local = _Local.of(problem, thetas, lin, model.index(block), np.array(block.at))
        forms = [(_promise(form, local, lin, k > 0), form) for form in _forms(local, block.role)]
        for promise, form in sorted(forms, key=lambda each: each[0])[:_TRIED]:
            changed = _replaced(model, thetas, k, form) if promise < 0.0 and form.shown else None
            if changed is None or not changed[0].admissible(changed[1][0]):
                continue
            kept = None if weights is None else weights[_others(model, k)]
            trial = (changed[0], *search_finer(*changed, data, normal, result, context, kept))
            value = _bic(data, *trial[1:])
            if value < bic:
                return trial, value
    return None


def _bic(data: IOData, normal: Normal, result: SearchResult) -> float:
    """BIC of the plain errors, but for a constant."""
    N, e = int(data.observed.sum()), result.problem.plain.residual(result.outcome.p)
    if e is None or not np.any(e):
        return np.inf
    return float(
        N * np.log(float(e @ e) * normal.size**2) + result.problem.uncertainty(result.outcome.p)[1] * np.log(N)
    )


def _promise(form: _Form, local: _Local, lin: Linearisation, has_filter: bool) -> float:
    """The change of BIC that the linearised fit tells of the map with this shape.

    With a filter before it the scale of the shape's input counts there already.
    """
    cost = local.rest + float(form.errors @ form.errors)
    return float(lin.N * np.log(cost / lin.cost) + (form.count - has_filter - local.count) * np.log(lin.N))


def _forms(local: _Local, role: str) -> Iterator[_Form]:
    """Every shape with the numbers that bring it nearest."""
    for degree in _DEGREES:
        columns = np.vander(local.at, degree + 1)
        theta = local.best(columns)
        count = int(np.linalg.matrix_rank(local.S @ (columns / np.abs(columns).max(axis=0))))
        block = Polynomial(degree, role=role, found=True)
        yield _Form(block, theta, 1.0, 0.0, local.errors(columns @ theta), count, shown=True)
    yield _cornered(local, Saturation(role=role, found=True), 2, gains=1)
    yield _cornered(local, DeadZone(role=role, found=True), 2, gains=1)
    yield _cornered(local, DeadZoneSaturation(role=role, found=True), 4, gains=2)


def _cornered(local: _Local, block: StaticBlock, corners: int, gains: int) -> _Form:
    """The shape with corners, gains and a level (q) near the map: from the best of many places, to the least errors.

    Both gains of two are the block's own; one is that of a filter beside it.
    """

    def curve(q: np.ndarray) -> np.ndarray:
        own = np.concatenate([np.sort(q[:corners]), q[corners:-1]])
        return q[-1] + (block.output(own, local.at) if gains == 2 else own[-1] * block.output(own[:-1], local.at))

    def errors(q: np.ndarray) -> np.ndarray:
        return local.errors(curve(q))

    def begun(places: tuple[float, ...]) -> np.ndarray:
        unit = [curve(np.array([*places, *row, 0.0])) for row in np.eye(gains)]
        return np.array([*places, *local.best(np.column_stack([*unit, np.ones(len(local.at))]))])

    few = local.at[np.linspace(0, len(local.at) - 1, _PLACES[corners]).astype(int)]
    begins = sorted(map(begun, combinations(few.tolist(), corners)), key=lambda q: float(np.sum(errors(q) ** 2)))
    sizes = [float(np.ptp(local.at)), float(np.ptp(local.values) / np.ptp(local.at)), float(np.ptp(local.values))]
    scale = np.repeat(np.maximum(sizes, 1e-300), [corners, gains, 1])
    bounds = [
        np.repeat([end, inf], [corners, gains + 1]) for end, inf in ((local.at[0], -np.inf), (local.at[-1], np.inf))
    ]
    ends = [least_squares(errors, q, x_scale=scale, bounds=bounds) for q in begins[:_BEGUN]]
    end = min(ends, key=lambda end: float(end.cost))
    places, slopes, level = np.sort(end.x[:corners]), end.x[corners:-1], float(end.x[-1])
    theta, gain = (np.concatenate([places, slopes]), 1.0) if gains == 2 else (places, float(slopes[0]))
    shown = bool(local.at[1] < places[0] and places[-1] < local.at[-2])
    return _Form(block, theta, gain, level, end.fun, int(np.linalg.matrix_rank(end.jac * scale)), shown)


def _replaced(model: Chain, thetas: np.ndarray, k: int, form: _Form) -> tuple[Chain, np.ndarray] | None:
    """The chain and its parameters (K, P) with the shape as block k; None where no block takes up its gain or level.

    A filter beside it takes up the gain, and what follows the level: a map of break points, else an offset behind all.
    """
    blocks, parts, theta = list(model.blocks), [thetas[:, model.index(block)] for block in model.blocks], form.theta
    if form.gain != 1.0:
        is_last = k == len(blocks) - 1 or isinstance(blocks[k + 1], Offset)
        beside, one, gain = (k - 1 if is_last else k + 1), np.ones(1), np.array([form.gain])
        law = None if form.gain == 0.0 else blocks[beside].law(*((one, gain) if is_last else (1.0 / gain, one)))
        if law is None or not _is_loose(model, blocks[beside]):
            return None
        parts[beside] = parts[beside] @ law.M.T
        theta = np.sort(form.gain * theta) if is_last else theta
    blocks[k], parts[k] = form.block, np.tile(theta, (len(thetas), 1))
    level = form.level
    for j in range(k + 1, len(blocks)):
        block = blocks[j]
        if isinstance(block, PiecewiseLinear):
            parts[j], level = np.array([block.output(row, np.array(block.at) + level) for row in parts[j]]), 0.0
        elif isinstance(block, Offset):
            parts[j], level = parts[j] + level, 0.0
        elif isinstance(block, TransferFunction):
            level *= block.gain(parts[j][0])
    if len(with_offset(blocks, 1, "free")) > len(blocks):
        blocks.append(Offset(role="offset", found=True))
        parts.append(np.full((len(thetas), 1), level))
    changed = replace(model, blocks=tuple(blocks)), np.hstack(parts)
    return changed if np.all(np.isfinite(changed[1])) else None


def _is_loose(model: Chain, block: Block) -> bool:
    """Whether no parameter of the block is held or limited by the user."""
    part = model.index(block)
    return bool(model.free[part].all()) and not any(name in model.bounds for name in model.names[part])


def _others(model: Chain, k: int) -> np.ndarray:
    """True for the changes of slope of every map but block k."""
    counts = [len(block.slope_changes()) for block in model.blocks]
    return np.repeat(np.arange(len(counts)) != k, counts)

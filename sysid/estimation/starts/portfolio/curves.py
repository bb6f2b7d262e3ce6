"""Curves through points at given places, and maps near to them.

A curve is linear in its values at fixed places, so that least squares finds it at once, and a search goes down without
the traps of break points that move. Places are chosen again on the signal that reaches the map, coarse to fine.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sysid.block.block import Block, StaticBlock
from sysid.blocks import Offset, PiecewiseLinear
from sysid.estimation.starts.portfolio.exchange import chords
from sysid.model.chain import Chain

_SAMPLE = 1000  # samples of a signal that give its quantiles
_FEW = 1e-6  # weight of the bends of a curve, relative to the data: it only decides where there are no data
_DRAWN, _TRIES = 40, 2  # variations of a map with a shape of its own, and how many of them start a search


def places(x: np.ndarray, count: int) -> np.ndarray:
    """`count` places over x (N,), half way between equal distances and equal numbers of samples."""
    even = np.linspace(float(x.min()), float(x.max()), count)
    if even[-1] <= even[0]:
        return even[0] + np.linspace(0.0, 1.0, count)
    sample = np.sort(x[:: max(1, len(x) // _SAMPLE)])
    quantiles = sample[np.linspace(0, len(sample) - 1, count).round().astype(int)]
    quantiles[0], quantiles[-1] = even[0], even[-1]
    return 0.5 * even + 0.5 * quantiles


def cell_of(x: np.ndarray, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For x (N,): the place (N,) of `knots` (k,) before it, and how far it is towards the next (N,), 0 to 1 inside."""
    i = np.clip(np.searchsorted(knots, x) - 1, 0, len(knots) - 2)
    return i, (x - knots[i]) / (knots[i + 1] - knots[i])


def hat_functions(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """The hat functions (N, k) at x (N,): a curve is a sum of them, weighted by its values at the places."""
    i, r = cell_of(x, knots)
    H = np.zeros((len(x), len(knots)))
    rows = np.arange(len(x))
    H[rows, i], H[rows, i + 1] = 1.0 - r, r
    return H


def fit_curve(x: np.ndarray, y: np.ndarray, knots: np.ndarray) -> tuple[np.ndarray, float]:
    """Values (k,) of the curve of least squares from x to y (N,), and its mean squared error."""
    i, r = cell_of(x, knots)
    k, s = len(knots), 1.0 - r
    diagonal_left, diagonal_right = np.bincount(i, s * s, k), np.bincount(i + 1, r * r, k)
    cross = np.bincount(i, s * r, k)[:-1]
    A = np.diag(diagonal_left + diagonal_right) + np.diag(cross, 1) + np.diag(cross, -1)
    h = np.bincount(i, s * y, k) + np.bincount(i + 1, r * y, k)
    bend = np.zeros((k - 2, k))
    width = np.diff(knots) / (knots[-1] - knots[0])
    for j in range(k - 2):
        bend[j, j : j + 3] = 1.0 / width[j], -1.0 / width[j] - 1.0 / width[j + 1], 1.0 / width[j + 1]
    A += _FEW * len(x) / k**3 * bend.T @ bend + 1e-12 * len(x) * np.eye(k)
    try:
        values = np.linalg.solve(A, h)
    except np.linalg.LinAlgError:
        return np.full(k, y.mean()), float(y.var())
    e = y - values[i] * s - values[i + 1] * r
    return values, float(e @ e) / len(e)


def thin_places(knots: np.ndarray, values: np.ndarray, sample_mass: np.ndarray, count: int) -> np.ndarray:
    """`count` of the places `knots` (k,) whose polygon is nearest to the curve, weighed by `sample_mass` (k,).

    Shortest path over the chords between two places each (Bellman 1961, Comm. ACM 4): the exact best choice.
    """
    k = len(knots)
    if k <= count:
        return knots
    cost = chords(knots, values, sample_mass)
    best, previous = np.full((count, k), np.inf), np.zeros((count, k), dtype=int)
    best[0, 0] = 0.0
    for m in range(1, count):
        total = best[m - 1][:, None] + cost
        previous[m], best[m] = total.argmin(axis=0), total.min(axis=0)
    path = [k - 1]
    for m in range(count - 1, 0, -1):
        path.append(int(previous[m, path[-1]]))
    return knots[path[::-1]]


def sample_mass(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Samples of x (N,) around each place (k,)."""
    i, r = cell_of(x, knots)
    r = np.clip(r, 0.0, 1.0)
    return np.bincount(i, 1.0 - r, len(knots)) + np.bincount(i + 1, r, len(knots))


@dataclass(frozen=True)
class NearestMap:
    """theta (p,): curve(x) is about `behind` times the map at `before` x. The filters beside it take the gains."""

    theta: np.ndarray
    before: float = 1.0
    behind: float = 1.0


def as_block(block: StaticBlock, knots: np.ndarray, values: np.ndarray, sample_mass: np.ndarray) -> NearestMap:
    """The map nearest to the curve `values` (k,) at the places `knots` (k,), weighed by `sample_mass` (k,)."""
    if isinstance(block, PiecewiseLinear) and block.free_knots:
        places = _spread_places(thin_places(knots, values, sample_mass, block.n), block.n)
        return NearestMap(np.concatenate([places, np.interp(places, knots, values)]))
    x = np.linspace(knots[0], knots[-1], 8 * len(knots))
    y = np.interp(x, knots, values)
    weight = np.sqrt(np.interp(x, knots, sample_mass) + 0.02 * sample_mass.max())
    rising = float(np.sum(weight * (x - x.mean()) * (y - y.mean()))) >= 0.0
    start, rng = block.start(x), np.random.default_rng(0)
    variations = [block.vary(start, rng) for _ in range(_DRAWN)]
    variations.sort(key=lambda theta: _cost_at(block, theta, x, y, weight))
    best, best_cost = NearestMap(start), np.inf
    for theta in (start, *variations[:_TRIES]):
        for sign in (1.0, -1.0) if theta is start else (1.0 if rising else -1.0,):
            candidate, cost = _nearest(block, x, y, weight, sign, theta)
            if cost < best_cost:
                best, best_cost = candidate, cost
    return best


def _cost_at(block: StaticBlock, theta: np.ndarray, x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> float:
    """The weighted squared error of the map at theta with the best gain and offset behind it."""
    with np.errstate(over="ignore", invalid="ignore"):
        A = weight[:, None] * np.column_stack([block.output(theta, x), np.ones_like(x)])
    if not np.all(np.isfinite(A)):
        return np.inf
    e = weight * y - A @ np.linalg.lstsq(A, weight * y)[0]
    return float(e @ e)


def _nearest(
    block: StaticBlock, x: np.ndarray, y: np.ndarray, weight: np.ndarray, sign: float, theta: np.ndarray
) -> tuple[NearestMap, float]:
    """A search from theta over the map's parameters, the gains before and behind it, and an offset for others."""
    gain = float(np.ptp(y) / (np.ptp(x) or 1.0)) or 1.0
    slots, n = block.slots(), len(theta)
    low = np.array([s.lower for s in slots] + [-np.inf] * 3)
    high = np.array([s.upper for s in slots] + [np.inf] * 3)
    # What the map can do by itself stays as it is.
    symmetries = block.symmetries(theta)
    needed_gains = np.array(
        [
            not any(
                s.in_scale for s in symmetries
            ),  # alone, or together with the output's: then the gain behind is enough
            not any(s.out_scale and not s.in_scale for s in symmetries),
            not any(s.out_shift and not s.in_shift for s in symmetries),
        ]
    )
    moving = np.concatenate([np.ones(n, dtype=bool), needed_gains])
    first = np.concatenate([theta, [1.0, sign * gain if needed_gains[1] else 1.0, 0.0]])
    first = np.clip(first, low + 1e-12, high - 1e-12)

    def full_vector(p: np.ndarray) -> np.ndarray:
        full = first.copy()
        full[moving] = p
        if not block.admissible(full[:n]):
            full[:n] = block.repair(full[:n])
        return full

    def error(p: np.ndarray) -> np.ndarray:
        full = full_vector(p)
        with np.errstate(over="ignore", invalid="ignore"):
            e = weight * (full[n + 1] * block.output(full[:n], full[n] * x) + full[n + 2] - y)
        return np.where(np.isfinite(e), e, 1e6 * (np.abs(y).max() + 1.0))

    try:
        with np.errstate(all="ignore"):  # values near the limits of numbers end the search, they do not warn
            out = least_squares(error, first[moving], bounds=(low[moving], high[moving]), x_scale="jac", max_nfev=60)
    except (ValueError, np.linalg.LinAlgError):
        return NearestMap(theta, 1.0, gain * sign), np.inf
    full = full_vector(out.x)
    return NearestMap(full[:n], float(full[n]), float(full[n + 1])), float(out.cost)


def _spread_places(places: np.ndarray, count: int) -> np.ndarray:
    """Exactly `count` places, the widest gaps halved, and none nearer to the next than a map admits."""
    rows = list(places)
    while len(rows) < count:
        k = int(np.argmax(np.diff(rows)))
        rows.insert(k + 1, 0.5 * (rows[k] + rows[k + 1]))
    knots, gap = np.array(rows), 0.011 * (rows[-1] - rows[0])
    for k in range(1, count):
        knots[k] = max(knots[k], knots[k - 1] + gap)
    return knots


def is_map(block: object) -> bool:
    """Whether a block is a map with parameters, and not the offset of an output."""
    return isinstance(block, StaticBlock) and block.n_parameters > 0 and not isinstance(block, Offset)


def line(knots: np.ndarray, role: str) -> PiecewiseLinear:
    """A piecewise linear map whose places are fixed."""
    return PiecewiseLinear(len(knots), free_knots=False, at=tuple(knots.tolist()), role=role)


def maps_of(chain: Chain, part: slice = slice(None)) -> list[tuple[slice, Block]]:
    """The maps of the chain's blocks in `part`, with the positions of their parameters in theta."""
    maps = []
    for block in chain.blocks[part]:
        start = chain.index(block).start
        maps += [(slice(start + place.start, start + place.stop), m) for place, m in block.parts() if is_map(m)]
    return maps


def movable_maps(chain: Chain) -> list[tuple[slice, PiecewiseLinear]]:
    """The maps whose break points may move, with the positions of their parameters in theta."""
    return [(place, m) for place, m in maps_of(chain) if isinstance(m, PiecewiseLinear) and m.free_knots and not m.at]

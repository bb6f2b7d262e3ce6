"""Moves of a fit that a search cannot make: break points laid again all at once, and other poles for one filter.

A search that moves break points ends in one of many local optima. Around a fit, the loss is a quadratic form in the
values of the map at many places; in it the best few of these places are found by exchange, without another run. Coarse
curves leave errors that hide a weak pole; with good curves the filter can be identified again from its own signals.
"""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

from sysid.block.block import Block
from sysid.blocks import PiecewiseLinear, TransferFunction
from sysid.data.record import IOData
from sysid.estimation.problem import ChainProblem
from sysid.estimation.starts._start import delay, denominators, filters_of, same_poles
from sysid.estimation.starts.portfolio import curves
from sysid.estimation.starts.portfolio.curves import maps_of, movable_maps
from sysid.estimation.starts.portfolio.exchange import Polygons
from sysid.estimation.starts.portfolio.members import random_poles
from sysid.estimation.starts.portfolio.surrogate import with_lines
from sysid.model.chain import Chain, columns
from sysid.solver.linearisation import Linearisation

# Chosen with the portfolio on drawn plants, see `sysid.estimation.search`.
_FINE = 40  # places among which break points are chosen
_SWEEPS = 4
_DRAWN = 6  # random choices that the exchange begins with, beside four that are thought out
_SHARES = (0.05, 0.2)  # of the gap to the next break point, for small moves
_DAMPING = 1e-3  # of the filters, in columns of unit norm
_POLES_DRAWN, _POLES_VARIED = 20, 10  # pole sets drawn, and varied from the present ones
_FLAT = 0.1  # of the mean slope: flatter parts of a map say little of what is before them


def move_breakpoints(
    chain: Chain, theta: np.ndarray, record: IOData, near: bool = False, gain: float = 0.003
) -> np.ndarray | None:
    """theta (P,) with the break points of one map laid again, or None if none promises a loss lower by `gain` of it.

    near: among places close to the present break points, else among places over the whole range. The filters move with
    the curve by a damped step.
    """
    if not movable_maps(chain):
        return None
    fine, values = _refine_curves(chain, theta, record, near)
    e, J = ChainProblem(fine, values[None, :], (record,), fine.free).linearise(np.zeros(len(values)))
    least, best, fresh = gain * float(e @ e), 0.0, None
    filter_rows, filter_places = (_beside_maps(c) for c in (fine, chain))
    if not np.all(np.isfinite(J)):
        return None
    fine_maps = dict(zip((at.start for at, _ in maps_of(chain)), maps_of(fine), strict=True))
    for at, block in movable_maps(chain):
        place, line = fine_maps[at.start]
        assert isinstance(line, PiecewiseLinear)
        places = np.array(line.at)
        lin = _damped_problem(e, J, filter_rows, place)
        n = len(filter_rows)
        M, z = lin.R[n:, n:], lin.z[n:] + lin.R[n:, n:] @ values[place]
        best_polygon = _best_polygon(M, z, places, theta[at][: block.n], least)
        if best_polygon is None or best_polygon[0] <= best:
            continue
        best, fresh = best_polygon[0], theta.copy()
        fresh[at] = best_polygon[1]
        change = np.interp(places, best_polygon[1][: block.n], best_polygon[1][block.n :]) - values[place]
        step = np.zeros(len(values))
        step[filter_rows] = solve_triangular(lin.R[:n, :n], lin.z[:n] - lin.R[:n, n:] @ change)
        fresh[filter_places] += (fine.basis @ step)[filter_rows]
        if not chain.admissible(fresh):
            fresh[filter_places] = theta[filter_places]
    return fresh


def _beside_maps(chain: Chain) -> np.ndarray:
    """Positions in theta of all that is not of a map."""
    return np.delete(np.arange(len(chain.names)), np.concatenate([np.r_[place] for place, _ in maps_of(chain)]))


def _damped_problem(e: np.ndarray, J: np.ndarray, rows: np.ndarray, place: slice) -> Linearisation:
    """The loss in the parameters `rows` (n,), damped, and then those of one map."""
    A = np.column_stack([J[:, rows], J[:, place]])
    size = np.linalg.norm(A, axis=0)
    damping = np.zeros((len(rows), A.shape[1]))
    np.fill_diagonal(damping, np.sqrt(_DAMPING) * np.where(size > 0, size, 1.0)[: len(rows)])
    return Linearisation.of(np.concatenate([e, np.zeros(len(rows))]), np.concatenate([A, damping]))


def _refine_curves(chain: Chain, theta: np.ndarray, record: IOData, near: bool) -> tuple[Chain, np.ndarray]:
    """The chain with its curves at many fixed places, among them the present break points, and its parameters."""
    movable = [block for _, block in movable_maps(chain)]

    def curve(block: Block, part: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        if not isinstance(block, PiecewiseLinear) or block not in movable:
            return None
        breakpoints = part[: block.n]
        low, high = float(x.min()), float(x.max())
        knots = np.concatenate([_close(breakpoints) if near else curves.places(x, _FINE), breakpoints, [low, high]])
        knots = np.sort(knots[(knots >= low) & (knots <= high)])
        knots = knots[np.concatenate([[True], np.diff(knots) > 1e-3 * (high - low)])]
        knots = knots if len(knots) > 1 else breakpoints  # of an input that does not move, which shows one place only
        return knots, block.output(part, knots)

    return with_lines(chain, theta, chain.signals(theta, record.u), curve)


def _close(breakpoints: np.ndarray) -> np.ndarray:
    """Places around break points (knots,), at shares of the gaps beside them."""
    gap = np.diff(breakpoints)
    return np.concatenate([breakpoints[1:-1] + side * share for share in _SHARES for side in (gap[1:], -gap[:-1])])


def _best_polygon(
    J: np.ndarray, z: np.ndarray, places: np.ndarray, breakpoints: np.ndarray, least: float
) -> tuple[float, np.ndarray] | None:
    """What is won, and break points with values (2 knots,), of the polygon that is best in |z - J v|^2.

    None if less than `least` is won.
    """
    G, h = J.T @ J, J.T @ z
    k, ridge = len(places), 1e-10 * float(np.diag(G).mean())
    G = G + ridge * np.eye(k)
    if k <= len(breakpoints) or not ridge > 0.0:
        return None
    present = _nearest(places, breakpoints)
    polygons = Polygons(G, h, places, ridge)
    start = polygons.best(present)[1]
    curve = np.linalg.lstsq(G, h, rcond=1e-10)[0]
    if start + float(h @ curve) < least:  # not even a curve without corners wins that much
        return None
    ways = [present, _nearest(places, curves.thin_places(places, curve, np.diag(G), len(breakpoints)))]
    ways += [
        _nearest(places, np.linspace(places[0], places[-1], len(breakpoints))),
        np.linspace(0, k - 1, len(breakpoints)).astype(int),
    ]
    rng = np.random.default_rng(0)
    ways += [
        np.concatenate([[0], np.sort(rng.choice(k - 2, len(breakpoints) - 2, False)) + 1, [k - 1]])
        for _ in range(_DRAWN)
    ]
    best, best_choice = start, present
    for way in ways:
        choice, cost = polygons.exchanged(way, _SWEEPS, 0.1 * least)
        if cost < best:
            best, best_choice = cost, choice
    if start - best < least:
        return None
    values = polygons.best(best_choice)[0]
    knots = places[best_choice]
    gap = 0.011 * (knots[-1] - knots[0])
    for j in range(1, len(knots)):
        knots[j] = max(knots[j], knots[j - 1] + gap)
    return start - best, np.concatenate([knots, np.interp(knots, places[best_choice], values)])


def _nearest(places: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Numbers (m,) of different places nearest to `targets` (m,); both ends are among them."""
    k, m = len(places), len(targets)
    numbers = {0, k - 1, *(int(np.argmin(np.abs(places - x))) for x in targets[1:-1])}
    spare = [i for i in range(k) if i not in numbers]
    while len(numbers) < m:
        numbers.add(spare.pop(len(spare) // 2))
    return np.array(sorted(numbers), dtype=np.int64)


def pole_alternatives(
    chain: Chain, theta: np.ndarray, record: IOData, rng: np.random.Generator, count: int
) -> list[np.ndarray]:
    """Up to `count` points theta (P,), each with other poles of one filter, the likeliest first."""
    signals = chain.signals(theta, record.u)
    e = record.y[:, 0] - signals[-1]
    if not np.all(np.isfinite(e)):
        return []
    pool: list[tuple[float, np.ndarray]] = []
    for k, block in enumerate(chain.blocks):
        if not filters_of(block) or any(map(filters_of, chain.blocks[k + 1 :])):
            continue  # what its output should be is hidden behind another filter
        change = _input_correction(chain, theta, k, signals[k + 1], e)
        for (part, entry), x in zip(block.parts(), columns(signals[k], block.channels[0]), strict=True):
            place = slice(chain.index(block).start + part.start, chain.index(block).start + part.stop)
            if isinstance(entry, TransferFunction) and entry.nf:
                pool += _filter_alternatives(theta, place, entry, x, entry.output(theta[place], x) + change, rng)
    pool.sort(key=lambda pair: pair[0])
    distinct: list[np.ndarray] = []
    for _, point in pool:
        rivals = [theta, *distinct]
        if all(not _same(chain, point, rival) for rival in rivals):
            distinct.append(point)
            if len(distinct) == count:
                break
    return distinct


def _input_correction(chain: Chain, theta: np.ndarray, k: int, w: np.ndarray, e: np.ndarray) -> np.ndarray:
    """What would have to be added to w (N,), the output of block k, to take away the errors e (N,)."""
    if k + 1 == len(chain.blocks):
        return e
    step = 1e-4 * float(np.ptp(w) or 1.0)
    slope = (chain.through(theta, w + step, k + 1) - chain.through(theta, w - step, k + 1)) / (2.0 * step)
    least = _FLAT * float(np.mean(np.abs(slope))) or 1.0
    return e * slope / (slope**2 + least**2)


def _filter_alternatives(
    theta: np.ndarray,
    place: slice,
    block: TransferFunction,
    x: np.ndarray,
    target: np.ndarray,
    rng: np.random.Generator,
) -> list[tuple[float, np.ndarray]]:
    """Losses and points with other poles of one filter from x to target (N,), its B and initial state solved for."""
    part = theta[place]
    denominators_tried = denominators(block, x - x.mean(), target - target.mean())
    denominators_tried += [np.real(np.poly(block.stretched(part, rng)))[1:] for _ in range(_POLES_VARIED)]
    denominators_tried += [random_poles(block.nf, len(x), rng) for _ in range(_POLES_DRAWN)]
    pool = []
    for f in denominators_tried:
        F = np.concatenate([[1.0], f])
        with np.errstate(over="ignore", invalid="ignore"):
            g, h = lfilter([1.0], F, x), lfilter([1.0], F, np.eye(1, len(x))[0])
        columns = [delay(g, block.nk + i) for i in range(block.nb)]
        columns += [delay(h, i) for i in range(block.n_state if block.initial_state else 0)]
        A = np.column_stack(columns)
        if not np.all(np.isfinite(A)):
            continue
        solution = np.linalg.lstsq(A, target, rcond=1e-10)[0]
        fresh = theta.copy()
        fresh[place] = np.concatenate([solution[: block.nb], f, solution[block.nb :]])
        if block.admissible(fresh[place]):
            pool.append((float(np.mean((target - A @ solution) ** 2)), fresh))
    return pool


def _same(chain: Chain, a: np.ndarray, b: np.ndarray) -> bool:
    return all(same_poles(block, a[part], b[part]) for part, block in chain.dynamics if block.nf)

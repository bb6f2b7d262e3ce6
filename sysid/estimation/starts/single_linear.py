"""Starts of one linear block between maps: linear models, maps around them, and variations."""

import numpy as np

from sysid.blocks import TransferFunction, TransferMatrix
from sysid.data.record import IOData
from sysid.estimation.problem import ChainProblem
from sysid.estimation.starts._start import (
    Start,
    best_output_error,
    coefficients,
    denominators,
    filter_blocks,
    generators,
    longest,
    same_poles,
    signals_of,
    solve_linear,
    start_maps,
)
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import LevenbergMarquardt

_COARSE = 12  # steps with coarse maps


class SingleLinear(Start):
    """One transfer function, or matrix of them, between maps: linear models, then variations of their poles and maps.

    Maps of many knots start with few knots; the best of these is a better starting point.
    """

    blocks = (TransferFunction, TransferMatrix)

    def suits(self, chain: Chain) -> bool:
        return len(filter_blocks(chain)) == 1

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        (u, y), draws = signals_of(longest(data)), generators(count, seed)
        coarse = chain.coarser()
        if coarse is None:
            return _start_points(chain, u, y, draws)
        # Most starts go by way of the coarse maps; the last ones do not, for where that way leads astray.
        direct = count // 3
        points = [
            chain.refine(coarse, _few_steps(coarse, theta, u, y))
            for theta in _start_points(coarse, u, y, draws[direct:])
        ]
        return points + (_start_points(chain, u, y, draws[: direct - 1]) if direct else [])


def _start_points(chain: Chain, u: np.ndarray, y: np.ndarray, draws: list[np.random.Generator]) -> list[np.ndarray]:
    """One start more than random draws: linear models for the first half, then variations of them."""
    count = len(draws) + 1
    points = linear_starts(chain, u, y)[: 1 + count // 2]
    return points + [
        _variation(chain, points[k % len(points)], u, y, rng) for k, rng in enumerate(draws[len(points) - 1 :])
    ]


def _few_steps(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta (P,) after a few Levenberg-Marquardt steps."""
    problem = ChainProblem.least_squares(chain, theta, u, y)
    out = iterate(problem, problem.start, LevenbergMarquardt(), Options.from_estimate(_COARSE))
    return problem.thetas(out.p)[0] if np.isfinite(out.cost) else theta


def linear_starts(chain: Chain, u: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """theta (P,) of linear models of u to y, the best first, with every map as near the identity as possible.

    The best output-error model comes first. Its poles may describe a static nonlinearity instead of the dynamics. The
    refined-IV models that it started from follow: they estimate the best linear approximation.
    """
    (linear,) = filter_blocks(chain)
    theta = np.zeros(len(chain.names))
    maps_before = chain.blocks[: chain.blocks.index(linear)]
    w = start_maps(chain, theta, maps_before, u, u - u.mean(axis=0))
    level, aim = w - w.mean(axis=0), y - y.mean(axis=0)
    raw = denominators(linear, level, aim)
    parts = [best_output_error(linear, raw, level, aim)]
    for f in raw:
        part = solve_linear(linear, f, level, aim)
        if not any(same_poles(linear, part, earlier) for earlier in parts):
            parts.append(part)
    points = []
    for part in parts:
        full = theta.copy()
        full[chain.index(linear)] = part
        _finish(chain, full, w, y)
        points.append(full)
    return points


def _finish(chain: Chain, theta: np.ndarray, w: np.ndarray, y: np.ndarray) -> None:
    """Fit the linear block's initial state and an offset (both enter linearly), then start the maps after it."""
    (linear,) = filter_blocks(chain)
    at_x0 = coefficients(linear)[2]
    part = chain.part(theta, linear).copy()
    part[at_x0] = 0.0
    x, J = Chain((linear,)).sensitivities(part, w)
    maps_after = chain.blocks[chain.blocks.index(linear) + 1 :]
    levels = np.kron(np.eye(x.shape[1]), np.ones((len(w), 1))) if any(b.n_parameters for b in maps_after) else J[:, :0]
    columns, offset = np.column_stack([J[:, at_x0], levels]), np.zeros(x.shape[1])
    if columns.shape[1] and np.all(np.isfinite(columns)) and np.all(np.isfinite(x)):
        solution = np.linalg.lstsq(columns, y.T.ravel() - x.T.ravel(), rcond=1e-10)[0]
        part[at_x0] = solution[: len(at_x0)]
        offset[: levels.shape[1]] = solution[len(at_x0) :]
    theta[chain.index(linear)] = part
    x = Chain((linear,)).through(part, w)
    start_maps(chain, theta, maps_after, x, x + offset)


def _variation(chain: Chain, first: np.ndarray, u: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Vary the maps before the linear block and its poles, fit B by least squares, and start the rest again."""
    (linear,) = filter_blocks(chain)
    at_b, at_f, _ = coefficients(linear)
    k = chain.blocks.index(linear)
    theta = first.copy()
    for b in chain.blocks[:k]:
        theta[chain.index(b)] = b.vary(chain.part(theta, b), rng)
    w = chain.through(theta, u, 0, k)
    part = chain.part(theta, linear).copy()
    if len(at_f):
        part = linear.vary(part, rng)
    x, J = Chain((linear,)).sensitivities(part, w)
    columns = np.column_stack([J[:, at_b], np.kron(np.eye(x.shape[1]), np.ones((len(w), 1)))])
    part[at_b] = np.linalg.lstsq(columns, y.T.ravel(), rcond=1e-10)[0][: len(at_b)]
    theta[chain.index(linear)] = part
    _finish(chain, theta, w, y)
    for b in chain.blocks[k + 1 :]:
        theta[chain.index(b)] = b.vary(chain.part(theta, b), rng)
    return theta

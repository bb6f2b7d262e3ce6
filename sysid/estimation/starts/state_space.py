"""Starts of a nonlinear state space: the best linear one, with networks that look in drawn directions."""

from dataclasses import replace

import numpy as np

from sysid.block.block import StaticBlock
from sysid.blocks import StateSpace
from sysid.data.record import IOData
from sysid.estimation.map_start import start_maps
from sysid.estimation.problem import ChainProblem
from sysid.estimation.start import Start, generators
from sysid.estimation.subspace import linear_state_space
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import LevenbergMarquardt

_DRAWN, _SHORT, _TRIAL = 4, 4000, Options(max_iterations=15)
_HELD = (1.0, 0.4, 0.15)  # shares of the correction by the measured output, on the way from prediction to free run


class StateSpaces(Start):
    """A state space, alone or with a static map behind it.

    The weights from features to states begin at zero, so that every start is the linear model; the first step of a
    search then is the least-squares fit of these weights to what the linear model leaves. Of several draws, the best
    after a few steps are the starts. Every second one takes its steps as a predictor first, see `_predicted`.
    """

    def applies(self, chain: Chain) -> bool:
        first, *others = chain.blocks
        return isinstance(first, StateSpace) and all(isinstance(b, StaticBlock) for b in others)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        block = chain.blocks[0]
        assert isinstance(block, StateSpace)
        u0, us, y0, ys = block.scales()
        on_scale = IOData((data.u - u0) / us, (data.y - y0) / ys, data.Ts, missing=data.missing, lengths=data.lengths)
        linear, own = linear_state_space(block.nx, on_scale)
        plain, m = block.split(np.zeros(block.n_parameters)), linear.split(own)
        first = block.joined(plain._replace(A=m.A, B=m.B, C=m.C, D=m.D, d=m.d, x0=m.x0))
        theta = np.zeros(len(chain.names))
        theta[chain.index(block)] = first
        if chain.blocks[1:]:
            e = data.experiments[0]
            x = Chain((block,)).simulate(first, e.u)
            start_maps(chain, theta, chain.blocks[1:], x, e.y[:, 0])
        if not block.features:
            return [theta]
        drawn = []
        for k, rng in enumerate([np.random.default_rng([seed, 0]), *generators(_DRAWN * count, seed)]):
            fresh, varied = theta.copy(), block.vary(first, rng)
            if k % 2 and len(chain.blocks) == 1 and not block.degree:
                varied = _predicted(block, varied, on_scale)
            fresh[chain.index(block)] = varied
            drawn.append(fresh)
        if not block.units:
            return drawn[:1]
        return _ahead(chain, theta, drawn, data)[:count]


def _ahead(chain: Chain, linear: np.ndarray, drawn: list[np.ndarray], data: IOData) -> list[np.ndarray]:
    """The drawn starts after a few iterations over the beginning of the record, the best first.

    The network's prior has a weight of a tenth of what the linear model leaves: with all of it most networks stay 0.
    """
    short = data.experiments[0].select(0, min(data.experiments[0].N, _SHORT))
    left = float(np.std(short.y - chain.outputs(linear, short.u)))
    found = [_steps(chain, theta, short, chain.free, 0.1 * left) for theta in drawn]
    return [theta for _, theta in sorted(found, key=lambda pair: pair[0])]


def _predicted(block: StateSpace, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (P,) after steps as a predictor, x(t+1) = ... + K (y - C x - ...), whose K then goes to zero in steps.

    Its errors do not add up over time, so that its cost has fewer valleys than that of a free run (Ljung, System
    Identification, section 7.2, and, on the way between both, Ribeiro et al. 2020, Automatica 121). A predictor is a
    state space with the output as a further input; data are on the block's scale.
    """
    short = data.experiments[0].select(0, min(data.experiments[0].N, _SHORT))
    seen = IOData(np.column_stack([short.u, short.y]), short.y, short.Ts, missing=short.missing)
    wide = replace(block, nu=block.nu + block.ny, u_centre=(), u_scale=(), y_centre=(), y_scale=())
    chain, m = Chain((wide,)), block.split(theta)
    moving, K = np.ones(wide.n_parameters, dtype=bool), np.zeros((block.nx, block.ny))
    for name, n in (("D", block.ny), ("V", block.units)):  # the output now is known to the next state alone
        moving[wide.places[name]] = np.tile(np.arange(wide.nu) < block.nu, n)
    for share in _HELD:
        L = share * K
        F = m.F if block.readout else np.zeros((block.ny, block.features))
        start = m._replace(A=m.A - L @ m.C, B=np.column_stack([m.B - L @ m.D, L]), E=m.E - L @ F)
        start = start._replace(
            D=np.column_stack([m.D, np.zeros((block.ny, block.ny))]),
            V=np.column_stack([m.V, np.zeros((block.units, block.ny))]),
        )
        moves = moving.copy()
        if share < _HELD[0]:
            moves[wide.places["B"]] = np.tile(np.arange(wide.nu) < block.nu, block.nx)
        cost, found = _steps(chain, wide.repair(wide.joined(start)), seen, moves, 0.05)
        if not np.isfinite(cost):
            return theta
        w = wide.split(found)
        L = w.B[:, block.nu :]
        K = L if share == _HELD[0] else K
        F = w.F if block.readout else np.zeros((block.ny, block.features))
        D = w.D[:, : block.nu]
        m = w._replace(A=w.A + L @ w.C, B=w.B[:, : block.nu] + L @ D, D=D, E=w.E + L @ F, V=w.V[:, : block.nu])
    return block.repair(block.joined(m))


def _steps(chain: Chain, theta: np.ndarray, data: IOData, moving: np.ndarray, prior: float) -> tuple[float, np.ndarray]:
    """Cost and parameters (P,) after a few iterations from theta (P,); infinite where theta gives no run."""
    weight = prior if np.isfinite(prior) else 0.0
    problem = ChainProblem(chain, theta[None, :], (data,), moving, curvature_weight=weight)
    out = iterate(problem, problem.start, LevenbergMarquardt(), _TRIAL)
    return out.cost, problem.thetas(out.p)[0]

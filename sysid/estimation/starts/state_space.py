"""Starts of a nonlinear state space: the best linear one, with networks that look in drawn directions."""

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


class StateSpaces(Start):
    """A state space, alone or with a static map behind it.

    The weights from features to states begin at zero, so that every start is the linear model; the first step of a
    search then is the least-squares fit of these weights to what the linear model leaves.
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
        for rng in [np.random.default_rng([seed, 0]), *generators(_DRAWN * count, seed)]:
            fresh = theta.copy()
            fresh[chain.index(block)] = block.vary(first, rng)
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
    found = []
    for theta in drawn:
        problem = ChainProblem(
            chain, theta[None, :], (short,), chain.free, curvature_weight=0.1 * left if np.isfinite(left) else 0.0
        )
        out = iterate(problem, problem.start, LevenbergMarquardt(), _TRIAL)
        found.append((out.cost, problem.thetas(out.p)[0]))
    return [theta for _, theta in sorted(found, key=lambda pair: pair[0])]

"""Starts of a nonlinear state space: the best linear one, with networks that look in drawn directions."""

import numpy as np

from sysid.block.block import StaticBlock
from sysid.blocks import StateSpace
from sysid.data.record import IOData
from sysid.estimation.map_start import start_maps
from sysid.estimation.start import Start, generators
from sysid.estimation.subspace import linear_state_space
from sysid.model.chain import Chain


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
        found = []
        for rng in [np.random.default_rng([seed, 0]), *generators(count, seed)]:
            fresh = theta.copy()
            fresh[chain.index(block)] = block.vary(first, rng)
            found.append(fresh)
        return found if block.units else found[:1]

"""A chain whose maps are straight lines between fixed places: easy to search, and then turned into the real chain.

Fixed places make a map linear in its parameters, so a search goes down without the traps of break points that move.
They are laid again on the signal that reaches the map, coarse to fine.
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.block.block import Block, StaticBlock
from sysid.blocks import PiecewiseLinear
from sysid.data.record import IOData
from sysid.estimation.portfolio import hats
from sysid.estimation.portfolio.mapped import as_block
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import LevenbergMarquardt


@dataclass(frozen=True)
class Surrogate:
    """A chain with maps at fixed places, its parameters, and its loss on the record that it was searched on."""

    chain: Chain
    theta: np.ndarray
    loss: float = np.inf
    member: str = ""

    def searched(self, record: IOData, iterations: int, curvature: float) -> "Surrogate":
        """After some steps of Levenberg-Marquardt; `curvature` as in `Objective`."""
        problem = ChainProblem(self.chain, self.theta[None, :], (record,), self.chain.free)
        e = problem.residual(problem.start)
        if e is None or not np.all(np.isfinite(e)):
            return self
        problem = replace(problem, curvature_weight=curvature * max(float(e.std()), 1e-9 * float(record.y.std())))
        out = iterate(problem, problem.start, LevenbergMarquardt(), Options(max_iterations=iterations, tolerance=0.1))
        theta = problem.thetas(out.p)[0]
        e = problem.bare.residual(out.p)
        return replace(self, theta=theta, loss=float(e @ e) / len(e) if e is not None else np.inf)

    def relaid(self, record: IOData, knots: int) -> "Surrogate":
        """The same curves with `knots` places each, laid on the signals of this record."""
        signals = self.chain.signals(self.theta, record.u[:, 0])
        blocks, parts = list[Block](), list[np.ndarray]()
        for block, x in zip(self.chain.blocks, signals, strict=False):
            part = self.chain.part(self.theta, block)
            if is_map(block):
                at = hats.places(x, knots)
                blocks.append(line(at, block.role))
                parts.append(block.output(part, at))
            else:
                blocks.append(block)
                parts.append(part)
        return replace(self, chain=replace(self.chain, blocks=tuple(blocks)), theta=np.concatenate(parts))

    def turned(self, chain: Chain, record: IOData) -> np.ndarray:
        """theta (P,) of the real chain, whose maps come as near to these curves as they can."""
        signals = self.chain.signals(self.theta, record.u[:, 0])
        parts = [self.chain.part(self.theta, block).copy() for block in self.chain.blocks]
        for k, (real, block) in enumerate(zip(chain.blocks, self.chain.blocks, strict=True)):
            if not is_map(block):
                continue
            assert isinstance(block, PiecewiseLinear)
            assert isinstance(real, StaticBlock)
            at, x = np.array(block.at), signals[k]
            found = as_block(real, at, parts[k], hats.mass(x, at))
            parts[k] = found.theta
            if k > 0:
                parts[k - 1] = _scaled(chain.blocks[k - 1], parts[k - 1], found.before)
            if k + 1 < len(parts):
                parts[k + 1] = _gained(chain.blocks[k + 1], parts[k + 1], found.behind)
        return np.concatenate(parts)


def is_map(block: object) -> bool:
    """Whether a block is a map with parameters."""
    return isinstance(block, StaticBlock) and block.n_parameters > 0


def line(at: np.ndarray, role: str) -> PiecewiseLinear:
    """A piecewise linear map whose places are fixed."""
    return PiecewiseLinear(len(at), free_knots=False, at=tuple(at.tolist()), role=role)


def _scaled(block, part: np.ndarray, gain: float) -> np.ndarray:
    """Parameters of a filter whose output is `gain` times as large, initial state included."""
    part = part.copy()
    part[: block.nb] *= gain
    part[block.nb + block.nf :] *= gain
    return part


def _gained(block, part: np.ndarray, gain: float) -> np.ndarray:
    """Parameters of a filter for an input that is 1 / `gain` times as large."""
    part = part.copy()
    part[: block.nb] *= gain
    return part

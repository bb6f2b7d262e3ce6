"""A chain whose maps are curves at fixed places: how it is made of a chain, searched, and turned into that chain."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.block.block import Block, StaticBlock
from sysid.blocks import Channels, Offset, PiecewiseLinear
from sysid.data.record import IOData
from sysid.estimation.problem import ChainProblem
from sysid.estimation.starts._start import filters_of, signals_of
from sysid.estimation.starts.portfolio.curves import NearestMap, as_block, fit_curve, is_map, line, places, sample_mass
from sysid.model.chain import Chain, columns
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import LevenbergMarquardt


@dataclass(frozen=True)
class Surrogate:
    """A chain with maps at fixed places, its parameters, its loss on the record, and where it comes from."""

    chain: Chain
    theta: np.ndarray
    loss: float = np.inf
    member: str = ""
    number: int = 0  # of the candidate that it comes from

    def search(self, record: IOData, iterations: int, curvature: float) -> "Surrogate":
        """After some steps of Levenberg-Marquardt; `curvature` as in `Objective`."""
        problem = ChainProblem(self.chain, self.theta[None, :], (record,), self.chain.free)
        e = problem.residual(problem.start)
        if e is None or not np.all(np.isfinite(e)):
            return self
        problem = replace(problem, curvature_weight=curvature * max(float(e.std()), 1e-9 * float(record.y.std())))
        out = iterate(problem, problem.start, LevenbergMarquardt(), Options.from_estimate(iterations))
        theta = problem.thetas(out.p)[0]
        e = problem.bare.residual(out.p)
        return replace(self, theta=theta, loss=float(e @ e) / len(e) if e is not None else np.inf)

    def lay_places(self, record: IOData, knots: int) -> "Surrogate":
        """The same curves with `knots` places each, laid on the signals of this record."""

        def curve(block: Block, part: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
            if not isinstance(block, StaticBlock) or not is_map(block):
                return None
            new_knots = places(x, knots)
            return new_knots, block.output(part, new_knots)

        chain, theta = with_lines(self.chain, self.theta, self.chain.signals(self.theta, record.u), curve)
        return replace(self, chain=chain, theta=theta)

    def to_chain(self, chain: Chain, record: IOData) -> np.ndarray:
        """theta (P,) of the real chain, whose maps come as near to these curves as they can.

        A map behind the last filter is fitted to the signal that really reaches it: a map before it may lack an
        offset.
        """
        inner = self.chain.signals(self.theta, record.u)
        parts = [self.chain.part(self.theta, block).copy() for block in self.chain.blocks]
        x, y = signals_of(record)
        for k, (real, block) in enumerate(zip(chain.blocks, self.chain.blocks, strict=True)):
            last = k > 0 and not any(map(filters_of, chain.blocks[k:]))
            pieces = [parts[k][place] for place, _ in block.parts()]
            inners = columns(inner[k], real.channels[0])
            for i, ((_, real_map), (_, curve)) in enumerate(zip(real.parts(), block.parts(), strict=True)):
                if isinstance(curve, PiecewiseLinear):
                    assert isinstance(real_map, StaticBlock)
                    knots, values, signal = np.array(curve.at), pieces[i], inners[i]
                    if last:
                        knots, signal = places(x, len(knots)), x
                        values = fit_curve(x, y, knots)[0]
                    nearest = as_block(real_map, knots, values, sample_mass(signal, knots))
                    if last:
                        nearest = _gain_before(real_map, nearest)
                    pieces[i] = nearest.theta
                    if k > 0:
                        parts[k - 1] = _scale(chain.blocks[k - 1], parts[k - 1], nearest.before, output=True)
                        x = x * nearest.before
                    if k + 1 < len(parts) and filters_of(chain.blocks[k + 1]):
                        parts[k + 1] = _scale(chain.blocks[k + 1], parts[k + 1], nearest.behind, input=i)
                elif isinstance(curve, Offset):
                    pieces[i] = np.array([np.mean(y - x)])
            parts[k] = np.concatenate(pieces)
            x = Chain((real,)).through(parts[k], x)
        return np.concatenate(parts)


def with_lines(
    chain: Chain,
    theta: np.ndarray,
    signals: Sequence[np.ndarray],
    curve: Callable[[Block, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray] | None],
) -> tuple[Chain, np.ndarray]:
    """The chain with lines in place of maps, and its theta; signals[k] goes into block k.

    `curve` has places and values (k,) of the line in place of a map with these parameters, which x (N,) goes into; None
    leaves a part of a block as it is.
    """
    blocks, thetas = list[Block](), list[np.ndarray]()
    for block, x in zip(chain.blocks, signals, strict=False):
        maps = list[Block]()
        for (place, part), xi in zip(block.parts(), _channels(block, x), strict=True):
            values = chain.part(theta, block)[place]
            drawn = curve(part, values, xi)
            maps.append(part if drawn is None else line(drawn[0], part.role))
            thetas.append(values if drawn is None else drawn[1])
        side_by_side = replace(block, maps=tuple(maps)) if isinstance(block, Channels) else block  # type: ignore[arg-type]
        blocks.append(maps[0] if len(maps) == 1 else side_by_side)
    return Chain(tuple(blocks), structure=chain.structure), np.concatenate(thetas)


def _channels(block: Block, x: np.ndarray) -> list[np.ndarray]:
    """What goes into each part of a block: x (N,) itself, or a column of it."""
    inputs = [x] if x.ndim == 1 else columns(x, x.shape[1])
    return [inputs[i % len(inputs)] for i in range(len(block.parts()))]


def _gain_before(block: StaticBlock, nearest: NearestMap) -> NearestMap:
    """The same where no filter behind the map takes its gain: a saturation of a larger signal has wider limits."""
    gain = np.array([nearest.behind])
    law = block.law(gain, gain)
    if law is None or nearest.behind == 1.0:
        return nearest
    return NearestMap(law.M @ nearest.theta, nearest.before * nearest.behind)


def _scale(block: Block, theta: np.ndarray, gain: float, input: int = 0, output: bool = False) -> np.ndarray:
    """Parameters of filters of one output whose input is 1 / `gain` times as large, or whose output is `gain` times so.

    An output takes its initial states with it.
    """
    theta = theta.copy()
    for i, ((place, _), entry) in enumerate(zip(block.parts(), filters_of(block), strict=True)):
        if output or i == input:
            theta[place][: entry.nb] *= gain
        if output:
            theta[place][entry.nb + entry.nf :] *= gain
    return theta

"""A chain for other signals: without the means of a record, and in other units.

The parameters of a map refer to zero, and a search is lost where the signals are far from there. A symmetry of the
block (`Block.symmetries`) says how theta goes with a small offset. For maps that are free on an interval it is affine
in theta, and the exponential of its matrix is the law for any offset.

In other units every block goes by its own law. Before the last block with a memory the signals inside are in the unit
of the input, behind it in that of the output: there the gain from one to the other has its place in a fit.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from sysid.block.block import Block, Law, StaticBlock
from sysid.block.symmetry import block_diagonal
from sysid.blocks import Channels
from sysid.model.chain import Chain

_APART = 3.7  # where the law is read off: knots are then no whole number apart
_MOST = 1e8  # of an entry of the law: half of the digits of a high power are lost there
_SMALLEST = 1e-152  # of a factor of a parameter, whose square is that of a variance


class Shift(NamedTuple):
    """theta = M theta there + m, where the input is u - input (nu,) and the output y - output (ny,)."""

    M: np.ndarray
    m: np.ndarray
    input: np.ndarray
    output: np.ndarray


def shift(chain: Chain, u: np.ndarray, y: np.ndarray) -> Shift:
    """The law of a chain for an input u (nu,) and an output y (ny,) less; an offset that it cannot take up is 0.

    That is one before a block that is not such a map, one that moves a parameter which the chain fixes or limits, and
    one so large that rounding would show.
    """
    law = Shift(np.eye(len(chain.names)), np.zeros(len(chain.names)), np.zeros_like(u), np.zeros_like(y))
    constrained = np.array([name in chain.fixed or name in chain.bounds for name in chain.names])
    for end, offsets, absorbed in (("in_shift", u, law.input), ("out_shift", y, law.output)):
        block = chain.blocks[0 if end == "in_shift" else -1]
        at = chain.index(block).start
        for channel, (positions, part) in enumerate(_maps(block)):
            flow = _flow(part, end, float(offsets[channel]))
            columns = slice(at + positions.start, at + positions.stop)
            if flow is None or np.any(np.any(flow != np.eye(len(flow)), axis=1)[:-1] & constrained[columns]):
                continue
            law.M[columns, columns] = flow[:-1, :-1] @ law.M[columns, columns]
            law.m[columns] = flow[:-1, :-1] @ law.m[columns] + flow[:-1, -1]
            absorbed[channel] = offsets[channel]
    return law


def _maps(block: Block) -> list[tuple[slice, Block]]:
    """The maps of a block, one for each of its channels in order; none of a block that is no map."""
    return block.parts() if isinstance(block, Channels) or block.channels == (1, 1) else []


def _flow(block: Block, end: str, offset: float) -> np.ndarray | None:
    """(p + 1, p + 1) that takes theta and a 1 to theta for an offset more; None of a block without such a law."""
    if not (block.centred and offset):
        return None
    base, p = block.start(np.linspace(0.0, _APART, 50)), block.n_parameters
    candidates = (_move(block, end, theta) for theta in (base, *(base + unit for unit in np.eye(p))))
    moves = [move for move in candidates if move is not None]
    if not moves:
        return None
    field = np.zeros((p + 1, p + 1))
    field[:-1, :-1] = np.transpose([move - moves[0] for move in moves[1:]])
    field[:-1, -1] = moves[0] - field[:-1, :-1] @ base
    flow = expm(offset * field)
    return flow if np.abs(flow).max() < _MOST else None


def _move(block: Block, end: str, theta: np.ndarray) -> np.ndarray | None:
    """d_theta (p,) of the symmetry of that name, None of a block that has none there: knots at given places."""
    return next((s.d_theta for s in block.symmetries(theta) if getattr(s, end)), None)


class Rescaled(NamedTuple):
    """A chain in other units, and M (P, P): theta = M theta there."""

    chain: Chain
    M: np.ndarray


def rescale(chain: Chain, a: np.ndarray, b: np.ndarray) -> Rescaled | None:
    """The chain for an input u / a (a (nu,)) and an output y / b (b (ny,)), powers of two or their negatives.

    None if a block has no law for these units. Where a signal changes its sign, values that the chain fixes or limits
    move with their parameters: the lower end of a dead zone is the upper one there. There is no chain then if such a
    parameter is a sum of several there.
    """
    laws = _laws(chain, a, b)
    if laws is None:
        return None
    M = block_diagonal(*(law.M for law in laws))
    sizes = np.abs(M[M != 0.0])
    if not np.all((sizes > _SMALLEST) & (sizes < 1.0 / _SMALLEST)) or not np.all(np.any(M != 0.0, axis=1)):
        return None  # a high power of a large unit
    scaled_chain = replace(chain, blocks=tuple(law.block for law in laws), fixed={}, bounds={})
    if not (chain.fixed or chain.bounds):
        return Rescaled(scaled_chain, M)
    place = np.argmax(M != 0.0, axis=1)
    fixed, bounds = {}, {}
    for name in {**chain.fixed, **chain.bounds}:
        i = chain.names.index(name)
        if np.count_nonzero(M[i]) > 1:
            return None
        name_there, factor = scaled_chain.names[place[i]], M[i, place[i]]
        if name in chain.fixed:
            fixed[name_there] = chain.fixed[name] / factor
        if name in chain.bounds:
            low, high = sorted(end / factor for end in chain.bounds[name])
            bounds[name_there] = (low, high)
    return Rescaled(replace(scaled_chain, fixed=fixed, bounds=bounds), M)


def _laws(chain: Chain, a: np.ndarray, b: np.ndarray) -> list[Law] | None:
    moving = [k for k in range(len(chain.blocks)) if _dynamic(chain, k)]
    change = moving[-1] if moving else len(chain.blocks) - 1
    laws = []
    for k, block in enumerate(chain.blocks):
        law = block.law(a if k <= change else b, a if k < change else b)
        if law is None:
            return None
        laws.append(law)
    return laws


def _dynamic(chain: Chain, k: int) -> bool:
    """Whether a part of the block has a memory; maps side by side have none."""
    return any(not isinstance(part, StaticBlock) for _, part in chain.blocks[k].parts())

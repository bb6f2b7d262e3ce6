"""A chain for signals without their means: maps at its ends take the offsets of a record up.

The parameters of a map refer to zero, and a search is lost where the signals are far from there. A symmetry of the
block (`Block.symmetries`) says how theta goes with a small offset. For maps that are free on an interval it is affine
in theta, and the exponential of its matrix is the law for any offset.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from sysid.block.block import Block
from sysid.blocks import Channels
from sysid.model.chain import Chain

_APART = 3.7  # where the law is read off: knots are then no whole number apart
_MOST = 1e8  # of an entry of the law: half of the digits of a high power are lost there


class Shift(NamedTuple):
    """theta = M theta there + m, where the input is u - input (nu,) and the output y - output (ny,)."""

    M: np.ndarray
    m: np.ndarray
    input: np.ndarray
    output: np.ndarray


def shifted(chain: Chain, u: np.ndarray, y: np.ndarray) -> Shift:
    """The law of a chain for an input u (nu,) and an output y (ny,) less; an offset that it cannot take up is 0.

    That is one before a block that is not such a map, one that moves a parameter which the chain fixes or limits, and
    one so large that rounding would show.
    """
    law = Shift(np.eye(len(chain.names)), np.zeros(len(chain.names)), np.zeros_like(u), np.zeros_like(y))
    held = np.array([name in chain.fixed or name in chain.bounds for name in chain.names])
    for end, offsets, taken in (("in_shift", u, law.input), ("out_shift", y, law.output)):
        block = chain.blocks[0 if end == "in_shift" else -1]
        at = chain.index(block).start
        for channel, (own, part) in enumerate(_maps(block)):
            flow = _flow(part, end, float(offsets[channel]))
            here = slice(at + own.start, at + own.stop)
            if flow is None or np.any(np.any(flow != np.eye(len(flow)), axis=1)[:-1] & held[here]):
                continue
            law.M[here, here] = flow[:-1, :-1] @ law.M[here, here]
            law.m[here] = flow[:-1, :-1] @ law.m[here] + flow[:-1, -1]
            taken[channel] = offsets[channel]
    return law


def _maps(block: Block) -> list[tuple[slice, Block]]:
    """The maps of a block, one for each of its channels in order; none of a block that is no map."""
    return block.parts() if isinstance(block, Channels) or block.channels == (1, 1) else []


def _flow(block: Block, end: str, offset: float) -> np.ndarray | None:
    """(p + 1, p + 1) that takes theta and a 1 to theta for an offset more; None of a block without such a law."""
    if not (block.centred and offset):
        return None
    base, p = block.start(np.linspace(0.0, _APART, 50)), block.n_parameters
    tried = (_move(block, end, theta) for theta in (base, *(base + unit for unit in np.eye(p))))
    moves = [move for move in tried if move is not None]
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

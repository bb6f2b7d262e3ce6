"""A chain in other units: every block by its own law, with the units of the signals between them.

Before the last block with a memory the signals inside are in the unit of the input, behind it in that of the output:
there the gain from one to the other has its place in a fit.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sysid.block.block import Law, StaticBlock
from sysid.block.units import joined
from sysid.model.chain import Chain

_SMALLEST = 1e-152  # of a factor of a parameter, whose square is that of a variance


class Rescaled(NamedTuple):
    """A chain in other units, and M (P, P): theta = M theta there."""

    chain: Chain
    M: np.ndarray


def rescaled(chain: Chain, a: np.ndarray, b: np.ndarray) -> Rescaled | None:
    """The chain for an input u / a (a (nu,)) and an output y / b (b (ny,)), powers of two or their negatives.

    None if a block has no law for these units. Where a signal changes its sign, values that the chain fixes or limits
    move with their parameters: the lower end of a dead zone is the upper one there. There is no chain then if such a
    parameter is a sum of several there.
    """
    laws = _laws(chain, a, b)
    if laws is None:
        return None
    M = joined(*(own.M for own in laws))
    sizes = np.abs(M[M != 0.0])
    if not np.all((sizes > _SMALLEST) & (sizes < 1.0 / _SMALLEST)) or not np.all(np.any(M != 0.0, axis=1)):
        return None  # a high power of a large unit
    there = replace(chain, blocks=tuple(own.block for own in laws), fixed={}, bounds={})
    if not (chain.fixed or chain.bounds):
        return Rescaled(there, M)
    place = np.argmax(M != 0.0, axis=1)
    fixed, bounds = {}, {}
    for name in {**chain.fixed, **chain.bounds}:
        i = chain.names.index(name)
        if np.count_nonzero(M[i]) > 1:
            return None
        other, factor = there.names[place[i]], M[i, place[i]]
        if name in chain.fixed:
            fixed[other] = chain.fixed[name] / factor
        if name in chain.bounds:
            low, high = sorted(end / factor for end in chain.bounds[name])
            bounds[other] = (low, high)
    return Rescaled(replace(there, fixed=fixed, bounds=bounds), M)


def _laws(chain: Chain, a: np.ndarray, b: np.ndarray) -> list[Law] | None:
    moving = [k for k in range(len(chain.blocks)) if _dynamic(chain, k)]
    change = moving[-1] if moving else len(chain.blocks) - 1
    found = []
    for k, block in enumerate(chain.blocks):
        own = block.law(a if k <= change else b, a if k < change else b)
        if own is None:
            return None
        found.append(own)
    return found


def _dynamic(chain: Chain, k: int) -> bool:
    """Whether a part of the block has a memory; maps side by side have none."""
    return any(not isinstance(part, StaticBlock) for _, part in chain.blocks[k].parts())

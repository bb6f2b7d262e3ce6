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

_SMALLEST = 1e-150  # of a factor of a parameter, whose square is that of a variance


class Rescaled(NamedTuple):
    """A chain in other units, and M (P, P): theta = M theta there."""

    chain: Chain
    M: np.ndarray


def rescaled(chain: Chain, a: np.ndarray, b: np.ndarray) -> Rescaled | None:
    """The chain for an input u / a (a (nu,)) and an output y / b (b (ny,)), powers of two or their negatives.

    None if a block has no law for these units. Values that the chain fixes or limits keep their places only where
    no signal changes its sign, so there is none then either.
    """
    held = bool(chain.fixed or chain.bounds)
    if held and min(a.min(), b.min()) < 0.0:
        return None
    laws = _laws(chain, a, b)
    if laws is None:
        return None
    M = joined(*(own.M for own in laws))
    sizes = np.abs(M[M != 0.0])
    if not np.all((sizes > _SMALLEST) & (sizes < 1.0 / _SMALLEST)) or not np.all(np.any(M != 0.0, axis=1)):
        return None  # a high power of a large unit
    if not held:
        return Rescaled(replace(chain, blocks=tuple(own.block for own in laws)), M)
    by = dict(zip(chain.names, np.diag(M).tolist(), strict=True))
    fixed = {name: value / by[name] for name, value in chain.fixed.items()}
    bounds = {name: (low / by[name], high / by[name]) for name, (low, high) in chain.bounds.items()}
    there = replace(chain, blocks=tuple(own.block for own in laws), fixed=fixed, bounds=bounds)
    return Rescaled(there, M)


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

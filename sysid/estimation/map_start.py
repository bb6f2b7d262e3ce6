"""Starts of static maps over the data, as near the identity as they can be."""

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import StaticBlock
from sysid.model.chain import Chain


def start_maps(chain: Chain, theta: np.ndarray, blocks: tuple, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Start static maps from x towards target, write them into theta and return their output."""
    for b in blocks:
        if not isinstance(b, StaticBlock):
            raise InputError(f"block {b.role!r} has no automatic start in this place; give fit() a start")
        part = _shifted(b, b.start(x), x, target)
        theta[chain.index(b)] = part
        x = b.output(part, x)
    return x


def _shifted(block: StaticBlock, theta: np.ndarray, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """theta moved along the block's own output shift, if it has one, so that its mean meets the target's."""
    for s in block.symmetries(theta):
        if s.out_shift == 1.0 and s.in_shift == 0.0:
            y = block.output(theta, x)
            return theta + s.d_theta * float(np.mean(target - y))
    return theta

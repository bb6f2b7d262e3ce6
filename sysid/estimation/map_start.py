"""Starts of static maps over the data, as near the identity as possible."""

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import StaticBlock
from sysid.model.chain import Chain


def start_maps(
    chain: Chain, theta: np.ndarray, blocks: tuple, x: np.ndarray, target: np.ndarray, straight: bool = False
) -> np.ndarray:
    """Start static maps from x to target, write them into theta and return their output.

    `straight`: on a straight line, see `StaticBlock.straight`.
    """
    for b in blocks:
        if not isinstance(b, StaticBlock):
            raise InputError(f"block {b.role!r} has no automatic start in this place; give fit() a start")
        part = _shifted(b, b.straight(x) if straight else b.start(x), x, target)
        theta[chain.index(b)] = part
        x = b.output(part, x)
    return x


def _shifted(block: StaticBlock, theta: np.ndarray, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """theta changed along the block's output shift, if it has one, so that the mean output equals the target's mean."""
    for s in block.symmetries(theta):
        if s.out_shift == 1.0 and s.in_shift == 0.0:
            y = block.output(theta, x)
            return theta + s.d_theta * float(np.mean(target - y))
    return theta

"""Starts of a chain with a block of the user's own, where every block says itself where it begins."""

import numpy as np

from sysid.blocks import Dynamic
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, generators, longest
from sysid.model.chain import Chain


class OwnBlocks(Start):
    """A chain of one input and one output with a step of the user's own; no other start knows what it does."""

    blocks = (Dynamic,)

    def suits(self, chain: Chain) -> bool:
        return chain.channels == (1, 1)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        x = longest(data).u[:, 0]
        parts = []
        for block in chain.blocks:
            parts.append(block.start(x))
            x = block.output(parts[-1], x)
        variations = [
            [block.vary(part, rng) for block, part in zip(chain.blocks, parts, strict=True)]
            for rng in generators(count, seed)
        ]
        return [np.concatenate(thetas) for thetas in (parts, *variations)]

"""A record in stretches, each with a starting position of its own: the cost of a free run over them bends less.

A joint integrates, so an error of its friction adds up over a whole record, and a small change of a value decides
whether a stop is reached in time. The cost over the whole record has many local minima for that reason; over stretches
it has few (multiple shooting: Bock and Plitt, IFAC Proceedings 17(2), 1984).
"""

import itertools

import numpy as np

from sysid.blocks import Compliance, ServoMotor
from sysid.data.record import IOData
from sysid.model.chain import Chain

STRETCHES = 6  # of a record
SHORTEST = 400  # samples of a stretch: over shorter ones friction shows less, since its errors do not add up
_NEAR = 0.3  # of a stretch, within which a cut is moved to where the joint rests
_STILL = 50  # a joint is still where it hardly moves over this share of a stretch


def in_stretches(data: IOData, chain: Chain) -> IOData:
    """The record cut where its output rests; the record itself where it is short or the chain has more state at rest.

    The motor's speed and what its delay holds are zero only where it rests.
    """
    if any(isinstance(b, Compliance | ServoMotor) for b in chain.blocks):
        return data
    parts, length = [], max(SHORTEST, data.N // STRETCHES)
    for e in data.experiments:
        edges = [0, *_cuts(e.y[:, 0], length), e.N]
        parts += [e.select(a, b) for a, b in itertools.pairwise(edges)]
    return data if len(parts) == len(data.lengths) else IOData.merge(*parts)


def _cuts(y: np.ndarray, length: int) -> list[int]:
    """Samples (K,) where a new stretch begins: near equal lengths, where y (N,) moves least."""
    count = len(y) // length
    reach, half = round(_NEAR * length), max(2, length // _STILL)
    moves = np.convolve(np.abs(np.diff(y, prepend=y[0])), np.ones(2 * half + 1), "same")
    found = []
    for k in range(1, count):
        first = round(k * len(y) / count) - reach
        found.append(first + int(np.argmin(moves[first : first + 2 * reach])))
    return found

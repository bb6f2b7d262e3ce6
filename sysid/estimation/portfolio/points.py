"""Starting points of one round: candidates ranked by least squares, then searched coarse to fine, the best go on."""

from dataclasses import dataclass

import numpy as np

from sysid.blocks import TransferFunction
from sysid.data.record import IOData
from sysid.estimation.portfolio import one_filter, two_filters
from sysid.estimation.portfolio.relay import movable
from sysid.estimation.portfolio.surrogate import Surrogate, is_map
from sysid.estimation.starts import starts
from sysid.model.chain import Chain

_LADDER = ((6, 6, 8), (3, 12, 8), (2, 20, 6))  # candidates that go on, places of their curves, steps
_ALIKE = 0.9995  # correlation of two candidates' signals above which they are one
_SAME = 1.02  # losses within this ratio are one optimum
_PLAIN = 3  # starts from the identity
LONGEST = 6000  # samples that rank candidates


@dataclass(frozen=True)
class Point:
    """A starting point theta (P,), the member that found it, and how many others came to the same loss."""

    theta: np.ndarray
    member: str
    agreed: int


def applies(chain: Chain) -> bool:
    """One filter between at most one map on each side, or two filters around a map; nothing of the model held."""
    if chain.channels != (1, 1) or chain.bounds or np.any(~chain.free & ~chain.initial):
        return False
    kinds = "".join(
        "L" if isinstance(b, TransferFunction) else "N" if is_map(b) else "1" if b.n_parameters == 0 else "?"
        for b in chain.blocks
    ).replace("1", "")
    return kinds in ("L", "NL", "LN", "NLN", "LNL")


def points(
    chain: Chain,
    record: IOData,
    seed: int,
    turn: int,
    count: int,
    curvature: float,
    known: np.ndarray | None = None,
) -> list[Point]:
    """The best points of a round, the best first.

    `count` limits how many candidates are searched; `known` (P,) is the best of earlier rounds.

    A single one comes from the linear models alone and goes through one rung: the quick look.
    """
    rng = np.random.default_rng([seed, turn])
    part = record if record.N <= LONGEST else record.select(0, LONGEST)
    if len(chain.dynamics) == 2:
        ranked = _distinct(two_filters.splits(chain, part, rng, turn, count > 1, known), min(count, _LADDER[0][0]))
        field = [two_filters.begun(chain, c, part) for c in ranked]
    else:
        ranked = _distinct(one_filter.candidates(chain, part, rng, turn, count > 1), min(count, _LADDER[0][0]))
        field = [one_filter.begun(chain, c, part) for c in ranked]
    for width, knots, steps in _LADDER if count > 1 else _LADDER[1:2]:
        knots = max(4, min(knots, part.N // 25))
        field = [s.relaid(part, knots).searched(part, steps, curvature) for s in field[: min(width, count)]]
        field.sort(key=lambda s: s.loss)
    told = _told_apart(field) if len(movable(chain)) == sum(map(is_map, chain.blocks)) else [(s, 1) for s in field]
    found = [Point(s.turned(chain, part), s.member, n) for s, n in told if np.isfinite(s.loss)]
    if turn == 0 and count > 1 and len(told) and len(movable(chain)) < sum(map(is_map, chain.blocks)):
        # A map with a shape of its own may not come near to a free curve; then the search begins at the identity.
        found += [Point(theta, "identity", 1) for theta in starts(chain, record, _PLAIN, seed)]
    return found


def _distinct(found: list, count: int) -> list:
    kept: list = []
    for c in sorted(found, key=lambda c: c.loss):
        if all(abs(np.corrcoef(c.signal, other.signal)[0, 1]) < _ALIKE for other in kept):
            kept.append(c)
            if len(kept) == count:
                break
    return kept


def _told_apart(field: list[Surrogate]) -> list[tuple[Surrogate, int]]:
    """One of those that came to the same loss, with their number."""
    kept: list[tuple[Surrogate, int]] = []
    for s in field:
        if not np.isfinite(s.loss):
            continue
        if kept and s.loss <= _SAME * kept[-1][0].loss:
            kept[-1] = (kept[-1][0], kept[-1][1] + 1)
        else:
            kept.append((s, 1))
    return kept

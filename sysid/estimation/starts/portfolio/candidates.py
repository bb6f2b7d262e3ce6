"""Starting points of one round: candidates ranked by least squares, then searched coarse to fine, the best go on."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.block.block import Block
from sysid.blocks import Offset
from sysid.data.record import IOData
from sysid.estimation.starts import starts
from sysid.estimation.starts._start import coefficients, filter_blocks, filters_of, signals_of
from sysid.estimation.starts.portfolio import curves, two_filters
from sysid.estimation.starts.portfolio.curves import is_map, maps_of, movable_maps
from sysid.estimation.starts.portfolio.members import MEMBERS
from sysid.estimation.starts.portfolio.screen import Candidate, Screen
from sysid.estimation.starts.portfolio.surrogate import Surrogate, with_lines
from sysid.model.chain import Chain

# Chosen with the portfolio on drawn plants, see `sysid.estimation.search`.
# Candidates that go on, places of their curves, steps. Coarse curves have few local optima, but an optimum of coarse
# curves need not lie near one of fine curves where a map folds or jumps: some candidates have fine curves at once.
_COARSE = ((6, 6, 8), (3, 12, 8), (2, 20, 6))
_FINE = ((3, 20, 8), (2, 20, 14))
Ladder = tuple[tuple[int, int, int], ...]
# Correlation of two candidates' signals above which they are one. All candidates of a round would else lie around one
# optimum and agree on it: of 24 plants with a fold on both sides of the filter 17 were found with 0.9995, 22 with 0.99.
_ALIKE = 0.99
_SAME = 1.02  # losses within this ratio are one optimum
_PLAIN = 3  # starts from the identity
LONGEST = 6000  # samples that rank candidates
_QUICK = ("approximation", "curved_input")  # members that need no draw and little time


@dataclass(frozen=True)
class StartingPoint:
    """A starting point theta (P,), the member that found it, and how many others came to the same loss."""

    theta: np.ndarray
    member: str
    agreed: int


def applies(chain: Chain) -> bool:
    """One filter for each input between at most one map on each side, or two filters around a map; nothing held.

    All of one output; two filters are of one input.
    """
    if chain.predicts or chain.channels[1] != 1 or chain.bounds or np.any(~chain.free & ~chain.initial):
        return False
    kinds = "".join(map(_kind, (b for b in chain.blocks if b.n_parameters and not isinstance(b, Offset))))
    return kinds in ("L", "NL", "LN", "NLN") or (kinds == "LNL" and chain.channels == (1, 1))


def _kind(block: Block) -> str:
    if filters_of(block):
        return "L"
    return "N" if all(is_map(part) for _, part in block.parts()) else "?"


def starting_points(
    chain: Chain,
    record: IOData,
    seed: int,
    turn: int,
    count: int,
    curvature: float,
    theta_best: np.ndarray | None = None,
) -> list[StartingPoint]:
    """The best points of a round, the best first.

    `count` limits how many candidates are searched; `theta_best` (P,) is the best of earlier rounds.

    A single one comes from the linear models alone and goes through one rung: the quick look.
    """
    rng = np.random.default_rng([seed, turn])
    part = record if record.N <= LONGEST else record.select(0, LONGEST)
    ladders: tuple[Ladder, ...] = (_COARSE, _FINE)
    if len(filter_blocks(chain)) == 2:
        chosen_candidates = _distinct(
            two_filters.splits(chain, part, rng, turn, count > 1, theta_best), min(count, _COARSE[0][0])
        )
        field = [two_filters.surrogate_of_split(chain, c, part) for c in chosen_candidates]
    else:
        chosen_candidates = _distinct(candidates(chain, part, rng, turn, count > 1), min(count, _COARSE[0][0]))
        field = [surrogate_of(chain, c, part) for c in chosen_candidates]
        # Where the screen has solved for the curves, fewer places than it has would lose what they tell.
        ladders = ladders if screen_of(chain, part).behind else (_COARSE[1:],)
    ladders = ladders if count > 1 else (_COARSE[1:2],)
    field = [replace(s, number=k) for k, s in enumerate(field)]
    climbed = [s for ladder in ladders for s in _climbed(field, ladder, part, count, curvature)]
    field = sorted(climbed, key=lambda s: s.loss)
    optima = _distinct_optima(field) if len(movable_maps(chain)) == len(maps_of(chain)) else [(s, 1) for s in field]
    points = [StartingPoint(s.to_chain(chain, part), s.member, n) for s, n in optima if np.isfinite(s.loss)]
    if turn == 0 and count > 1 and len(optima) and len(movable_maps(chain)) < len(maps_of(chain)):
        # A map with a shape of its own may not come near to a free curve; then the search begins at the identity.
        points += [StartingPoint(theta, "identity", 1) for theta in starts(chain, record, _PLAIN, seed)]
    return points


def _climbed(field: list[Surrogate], ladder: Ladder, record: IOData, count: int, curvature: float) -> list[Surrogate]:
    """The best of at most `count` candidates at the end of a ladder, the best first."""
    for width, knots, steps in ladder:
        knots = max(4, min(knots, record.N // 25))
        field = [s.lay_places(record, knots).search(record, steps, curvature) for s in field[: min(width, count)]]
        field.sort(key=lambda s: s.loss)
    return field


def _distinct(pool: list, count: int) -> list:
    distinct: list = []
    for c in sorted(pool, key=lambda c: c.loss):
        if all(abs(np.corrcoef(c.signal, rival.signal)[0, 1]) < _ALIKE for rival in distinct):
            distinct.append(c)
            if len(distinct) == count:
                break
    return distinct


def _distinct_optima(field: list[Surrogate]) -> list[tuple[Surrogate, int]]:
    """One of those that came to the same loss, with the number of candidates that they come from."""
    optima: list[tuple[Surrogate, set[int]]] = []
    for s in field:
        if not np.isfinite(s.loss):
            continue
        if optima and s.loss <= _SAME * optima[-1][0].loss:
            optima[-1][1].add(s.number)
        else:
            optima.append((s, {s.number}))
    return [(s, len(numbers)) for s, numbers in optima]


def candidates(chain: Chain, record: IOData, rng: np.random.Generator, turn: int, draw: bool) -> list[Candidate]:
    """Candidates of one round, unsorted; later rounds only draw."""
    screen = screen_of(chain, record)
    pool: list[Candidate] = []
    for name, member in MEMBERS.items():
        if (name in _QUICK or draw) and (turn == 0 or name == "drawn"):
            for f in member(screen, rng):
                pool += screen.candidates(name, f, rng if name == "drawn" else None)
    return pool


def screen_of(chain: Chain, record: IOData) -> Screen:
    """What all candidates of a record share."""
    (linear,), (u, y) = filter_blocks(chain), signals_of(record)
    k = chain.blocks.index(linear)
    before, behind = (bool(maps_of(chain, part)) for part in (slice(k), slice(k + 1, None)))
    return Screen(u, y, linear, before, behind)


def surrogate_of(chain: Chain, c: Candidate, record: IOData) -> Surrogate:
    """The chain of straight lines that a candidate describes."""
    screen = screen_of(chain, record)
    linear, theta = screen.linear, np.zeros(len(chain.names))
    k = chain.blocks.index(linear)
    b, w, rises = c.b, c.signal, np.zeros(len(screen.filters))
    if not screen.behind:
        gain = float(np.cov(w, screen.y)[0, 1] / (w.var() or 1.0))
        b, w = gain * b, gain * w
        B1 = np.array([part.sum() for part in np.split(b, np.cumsum([entry.nb for entry in screen.filters])[:-1])])
        F1 = np.array([1.0 + F[1:].sum() for F in screen.denominators_of(c.f)])
        gains = np.divide(B1, F1, out=np.zeros(len(F1)), where=F1 != 0.0)  # an integrator holds no constant
        i = int(np.argmax(np.abs(gains)))
        if screen.before and abs(B1[i]) > 1e-9 * np.abs(b).max():
            rises[i] = float(np.mean(screen.y - w)) * F1[i] / B1[i]
    at_b, at_f, _ = coefficients(linear)
    theta[chain.index(linear).start + at_b], theta[chain.index(linear).start + at_f] = b, c.f
    for block in chain.blocks[k + 1 :]:
        if isinstance(block, Offset) and not (screen.behind or screen.before):  # else a curve holds it
            theta[chain.index(block)] = np.mean(screen.y - w)
    given = iter(zip(c.curve or (), rises, strict=False))

    def curve(block: Block, part: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        if not is_map(block):
            return None
        if x is w:
            knots = curves.places(w, 8)
            return knots, curves.fit_curve(w, screen.y, knots)[0]
        values, rise = next(given)
        knots = curves.places(x, len(values[0]))
        return knots, np.interp(knots, *values) + rise

    signals = [screen.u] * (k + 1) + [w] * (len(chain.blocks) - k - 1)
    return Surrogate(*with_lines(chain, theta, signals, curve), member=c.member)

"""Which physical effect explains how much of a departure: each effect's values are moved in the twin until it fits.

All simulations of a round run in one batch. Shares refer to what noise does not explain.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.compare.departure import noise_of
from twin.compare.effects import SLOPE, START, ZERO
from twin.compare.evidence import beyond_chance, independent_samples, schwarz
from twin.compare.intervals import Value, values
from twin.compare.remainder import Remainder, remainder
from twin.compare.search import Search, Trials, fit_all, refine, restart
from twin.compare.structures import CAUSES, STRUCTURES
from twin.follow import VISIBLE

MOST = 3  # effects that are named one after the other
WORTH = 0.03  # share of the departure that a further effect must explain
_ALIKE = 6.0  # a difference of twice the log likelihood below this does not tell two effects apart
_SCALED = 0.2  # of the range: from here the log's scale is guessed from its range
_EXPECTED = {"shank_mass": 0.05}  # [kg] standard deviation: a load at the foot is told apart from it by nothing else
_SETTLED = 1.1  # times the noise: a remainder below this needs no further effect


@dataclass(frozen=True)
class Change:
    """A value that was moved: what the twin has, and what the log asks for, with its interval."""

    name: str
    twin: float
    log: Value


@dataclass(frozen=True)
class Share:
    """One effect moved alone (beside those named before it): the share of the departure that vanishes, 0 to 1, and the
    RMS [rad] that is left. `changes` are empty for an effect that is not named."""

    effect: str
    share: float
    rms: float
    changes: tuple[Change, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """RMS of the departure and standard deviation of the noise [rad]; every effect moved alone, best first.

    `named`: the effects that explain most of the departure, in order, each beside those before it; `left` is what they
    leave. They are its cause only where that is nothing (`known`). `alike`: effects that explain as much as the first
    one does on this record. `chance`: the departure is no larger than noise makes it.
    The departure is that of the first `seconds` [s] of the record, from the best start. `state`: all knobs that were
    moved and the start, as they fit best.
    """

    rms: float
    noise: float
    alone: tuple[Share, ...]
    named: tuple[Share, ...]
    alike: tuple[str, ...]
    chance: bool
    seconds: float
    simulations: int
    state: Mapping[str, float]
    left: Remainder

    @property
    def known(self) -> bool:
        """Whether the departure is explained, in every part of the record alike."""
        return self.left.none

    @property
    def first(self) -> str | None:
        """The effect named first; None if there is no departure beyond noise, or none of the effects is its cause."""
        return self.named[0].effect if self.named and self.known else None

    @property
    def explained(self) -> float:
        """Share of the departure that all named effects explain together, 0 to 1."""
        return self.named[-1].share if self.named else 0.0


def explain(
    trials: Trials, tell: Callable[[str], None] = lambda text: None, effects: Sequence[str] = tuple(CAUSES)
) -> Verdict:
    """The verdict on the departure of the log of `trials` from its twin.

    The first angle of the drive is free throughout: one noisy reading does not tell it.
    """
    joint, y = trials.follower.joint, trials.follower.y
    base = Search("", ())
    singles = [Search(name, CAUSES[name].knobs_of(joint)) for name in effects]
    for search in singles:
        search.tries = _other_scale(trials) if SLOPE in search.knobs else _tries(trials, search.name, {})
    tell("each effect alone")
    fit_all(trials, [base, *singles], y)
    singles.sort(key=lambda search: _score(search, len(y)))
    restart(trials, singles, y, noise_of(y) ** 2)
    singles.sort(key=lambda search: _score(search, len(y)))
    noise = min(noise_of(y) ** 2, base.cost, *(search.cost for search in singles))
    winner = _better_than_chance(base, singles, len(y))
    winner = winner if winner is None or base.cost - winner.cost > VISIBLE**2 else None
    searches = [] if winner is None else [winner]
    while winner is not None and len(searches) < MOST and searches[-1].cost > _SETTLED * noise:
        last = searches[-1]
        names = last.name.split("+")
        candidates = [
            Search(
                f"{last.name}+{name}",
                last.knobs + CAUSES[name].knobs_of(joint),
                dict(last.state),
                tries=_tries(trials, name, last.state),
            )
            for name in effects
            if name not in names
        ]
        tell(f"beside {' and '.join(CAUSES[name].words for name in names)}")
        fit_all(trials, candidates, y, rounds=3)
        candidates.sort(key=lambda search: _score(search, len(y)))
        winner = _better_than_chance(last, candidates, len(y))
        if winner is None or last.cost - winner.cost < WORTH * (base.cost - noise):
            break
        searches.append(winner)
    searches = _drop_superfluous(trials, base, searches, y)
    noise = min([noise, *(search.cost for search in searches)])
    # A search that ended above the base has found nothing: its values stay the twin's, with which it is the base.
    shares = [Share(s.name, _explained_share(s, base, noise), float(np.sqrt(min(s.cost, base.cost)))) for s in singles]
    named_shares = [
        Share(s.name.split("+")[-1], _explained_share(s, base, noise), float(np.sqrt(s.cost))) for s in searches
    ]
    if searches:
        changes = _changes(trials, searches[-1], y)
        named_shares = [
            Share(s.effect, s.share, s.rms, tuple(c for c in changes if c.name in CAUSES[s.effect].knobs_of(joint)))
            for s in named_shares
        ]
    return Verdict(
        float(np.sqrt(base.cost)),
        float(np.sqrt(noise)),
        tuple(shares),
        tuple(named_shares),
        _alike(trials, singles, y) if searches else (),
        not searches,
        trials.follower.log.N * trials.follower.log.Ts,
        trials.simulated,
        dict(searches[-1].state if searches else base.state),
        remainder(trials, searches[-1] if searches else base, y),
    )


def _tries(trials: Trials, name: str, state: Mapping[str, float]) -> tuple[dict[str, float], ...]:
    """Where the search for a structure begins, beside what `state` has."""
    if name not in STRUCTURES:
        return ()
    f, tries = trials.follower, list(STRUCTURES[name].tries)
    if guess := STRUCTURES[name].guess:
        tries += guess(f.u, f.y, trials.rows([state])[0], f.log.Ts)
    return tuple({**state, **values} for values in tries)


def _drop_superfluous(trials: Trials, base: Search, searches: list[Search], y: np.ndarray) -> list[Search]:
    """The effects that are still needed once all are named, in order: a later one may do what the first one stood for.

    Without one of them the others are fitted again; if that costs no more than chance, it goes.
    """
    names = searches[-1].name.split("+") if searches else []
    joint, full = trials.follower.joint, searches[-1] if searches else base
    for name in names[:-1]:
        rest = [effect for effect in full.name.split("+") if effect != name]
        knobs = tuple(knob for effect in rest for knob in CAUSES[effect].knobs_of(joint))
        search = Search("+".join(rest), knobs, {k: v for k, v in full.state.items() if k in (START, *knobs)})
        refine(trials, search, y)
        if _better_than_chance(search, [full], len(y)) is None:
            full = search
    if full is (searches[-1] if searches else base):
        return searches
    result = []
    for k in range(1, len(full.name.split("+")) + 1):
        part = full.name.split("+")[:k]
        knobs = tuple(knob for effect in part for knob in CAUSES[effect].knobs_of(joint))
        search = Search("+".join(part), knobs, {n: v for n, v in full.state.items() if n in (START, *knobs)})
        refine(trials, search, y)
        result.append(search)
    return result


def _other_scale(trials: Trials) -> tuple[dict[str, float], ...]:
    """Slope and zero from the ranges of the log and the twin's response, if they differ much: a wrong unit, say."""
    (row,) = trials.rows([{}])
    y, wide = trials.follower.y, float(np.ptp(row))
    slope = float(np.ptp(y)) / wide if wide > 0 else 1.0
    if not np.isfinite(slope) or abs(slope - 1.0) < _SCALED:
        return ()
    zero = float(y.min() - slope * row.min())
    knob = trials.knobs[START]
    return ({SLOPE: slope, ZERO: zero, START: float(np.clip((y[0] - zero) / slope, knob.lower, knob.upper))},)


def _score(search: Search, N: int) -> float:
    """Schwarz's criterion: of two effects that explain as much, the one with fewer values goes first."""
    return schwarz(search.cost, len(search.free), N)


def _better_than_chance(base: Search, candidates: Sequence[Search], N: int) -> Search | None:
    """The best of `candidates`, if it fits better than chance makes it (likelihood ratio, Bonferroni over all)."""
    best = candidates[0]
    more = len(best.free) - len(base.free)
    return best if beyond_chance(base.cost, best.cost, more, len(candidates), N) else None


def _explained_share(search: Search, base: Search, noise: float) -> float:
    if base.cost <= noise:
        return 0.0
    return float(np.clip((base.cost - search.cost) / (base.cost - noise), 0.0, 1.0))


def _alike(trials: Trials, searches: Sequence[Search], y: np.ndarray) -> tuple[str, ...]:
    """Effects whose fit this record cannot tell from the best one's; coloured residuals count as fewer samples."""
    (row,) = trials.rows([searches[0].state])
    samples, best = independent_samples(y - row, len(y)), searches[0].cost
    return tuple(s.name for s in searches[1:] if samples * np.log(s.cost / best) < _ALIKE)


def _changes(trials: Trials, search: Search, y: np.ndarray) -> tuple[Change, ...]:
    """Every value that was moved; of two masses that act alike, one is expected near the twin's."""
    twins = {name: std for name, std in _EXPECTED.items() if name in search.knobs}
    if twins:
        search = replace(search, expected=twins, noise=noise_of(y) ** 2, damping=0.01, last=None, done=False)
        refine(trials, search, y)
    return tuple(
        Change(value.name, trials.knobs[value.name].nominal, value)
        for value in values(trials, search, y)
        if value.name != START
    )

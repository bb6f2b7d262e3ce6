"""An actuated joint with as much physics as the record supports: parts are added one by one while they help."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.joint_parts import lifted, shaken, traded
from sysid.estimation.objective import Objective
from sysid.estimation.race import Run, with_curvature_weight
from sysid.estimation.result import Fit
from sysid.joint.ends import WORDS as ENDS_IN_WORDS
from sysid.joint.ends import Ends, chosen_ends
from sysid.joint.parts import PARTS, again, is_plain, more
from sysid.joint.pruning import pruned, remaining
from sysid.joint.unseen import Unseen, free_runs, harms, unseen_folds
from sysid.model.chain import Chain
from sysid.selection.folds import Fold
from sysid.solver.iterate import Options
from sysid.structures import actuated_joint

# Three times what counts as very strong evidence (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995, section 3.2):
# residuals of a model that is not quite the joint are coloured, and BIC takes them as white.
MARGIN = 30.0
CLOSE = 10.0  # difference of BIC between two parts that is no very strong evidence (the same source)
WORDS = {name: part.words for name, part in PARTS.items()}
_SHAKES = 12  # places near an optimum that are tried
_USUAL, _LAST = (4, 3), (15, 8)  # iterations at each of these places, and how many go on; for the whole joint
_ROUNDS = 4  # at most, of the last search, as long as each lowers BIC by MARGIN
_WAYS = 2  # starts anew, at most, to come to the same joint
_BETTER = 1.0  # of BIC, less than which is the same optimum reached to another tolerance
_TELLING = 2.0  # times the error over the whole record, up to which free runs over unseen parts can judge a part
_LOST = 3.0  # points of fit on unseen parts that a warning speaks of


@dataclass(frozen=True)
class Step:
    """One part tried in a round: BIC with it, its reduction of BIC, and whether the part was kept.

    `unseen` is the ratio of the free-run error on unseen parts of the record with the part to that without it, nan if
    the part did not lower BIC enough to be asked.
    """

    round: int
    part: str
    bic: float
    earned: float
    kept: bool
    unseen: float = float("nan")


@dataclass(frozen=True)
class Growth:
    """The resulting joint, BIC of the plain joint, and the parts tried, in order.

    `ends` says which end stops the record shows ("none", "straight", "lower", "upper", "both"; see
    `sysid.joint.ends`). `dropped` are the parts that were kept, and that the grown joint does without. `undecided`
    names parts that the record does not tell apart from a kept one. `agreed` counts independent starts that came to
    this joint; `unseen_percent` is its free-run fit [%] on parts of the record that it was not fitted to. `warnings`
    are sentences for a report.
    """

    fit: Fit
    plain_bic: float
    steps: tuple[Step, ...]
    ends: str = "both"
    dropped: tuple[str, ...] = ()
    undecided: tuple[tuple[str, str], ...] = ()
    agreed: int = 1
    unseen_percent: float = float("nan")
    warnings: tuple[str, ...] = field(default=())

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts that the joint has."""
        return remaining(tuple(step.part for step in self.steps if step.kept), self.dropped)

    def sentence(self) -> str:
        """The parts kept, in words."""
        stops = "" if self.ends == "both" else f" The record shows {ENDS_IN_WORDS[self.ends]}."
        if not self.parts:
            return (
                "No part other than dry friction and a position-dependent load improves BIC enough on this record."
                + stops
            )
        steps = [(name, step.bic) for step in self.steps if step.kept for name in remaining((step.part,), self.dropped)]
        kept = [f"{WORDS[name]} ({bic:.0f})" for name, bic in steps]
        doubt = "".join(
            f" The record does not tell {WORDS[kept]} from {WORDS[other]}." for kept, other in self.undecided
        )
        return (
            f"Kept beside dry friction and a position-dependent load (BIC {self.plain_bic:.0f}): {', '.join(kept)}."
            + doubt
            + stops
        )

    def as_dict(self) -> dict[str, Any]:
        """The steps, ready for JSON."""
        steps = [{**vars(s), "unseen": s.unseen if np.isfinite(s.unseen) else None} for s in self.steps]
        return {
            "plain_bic": self.plain_bic,
            "parts": list(self.parts),
            "ends": self.ends,
            "dropped": list(self.dropped),
            "undecided": [list(pair) for pair in self.undecided],
            "agreed": self.agreed,
            "unseen_percent": self.unseen_percent if np.isfinite(self.unseen_percent) else None,
            "steps": steps,
        }


def grow_joint(
    data: IOData,
    plain: Chain | None = None,
    search: str = "lm",
    starts: int = 4,
    seed: int = 0,
    parts: Iterable[str] = tuple(PARTS),
    progress: Callable[[str], None] | None = None,
) -> Growth:
    """Fit an actuated joint to `data` and repeatedly add the part that lowers BIC most, as long as one does.

    Parts: "stribeck" (friction that falls with speed), "loss" (screw friction proportional to the load), "jams" (the
    motor jams at an end stop), "screw" (both), "plays" (backlash), "coasts" (backlash whose link has inertia and
    weight), "turns" (a load that repeats every turn of a joint without travel map, as a pendulum's). Each part starts
    from the current fit, must lower BIC by `MARGIN`, and must not do harm in free run over parts of the record that it
    was not fitted to. The end stops are chosen first, by the same rules. `plain` is the initial joint, an
    `actuated_joint` with a motor and without those parts or backlash; search, starts, seed and progress are those of
    `sysid.fit`. Raises InputError for an unsuitable part or plain joint, and the errors of `sysid.fit`.
    """
    names = tuple(parts)
    for part in names:
        if part not in PARTS:
            raise unknown("part of a joint", part, PARTS)
    chain = actuated_joint(play=False) if plain is None else plain
    if not is_plain(chain):
        raise InputError("grow_joint begins with a plain actuated_joint; leave Stribeck, loss, jam and play out")
    options: dict[str, Any] = {"search": search, "seed": seed, "progress": progress}
    pair = unseen_folds(data)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # a motor that does not suit runs away
        both = fit_chain(chain, data, starts=starts, **options)
        ends = chosen_ends(both, data, pair, MARGIN, options, turns="turns" in names)
        growth = _grown(_shaken(ends.fit, data, options), data, pair, names, options)
        return _checked(replace(growth, ends=ends.which), ends, data, pair, starts, options)


def _grown(fit: Fit, data: IOData, pair: tuple[Fold, ...], names: tuple[str, ...], options: dict[str, Any]) -> Growth:
    """The parts, round by round."""
    first, steps, undecided = float(fit.criteria.bic), [], []
    for k in count():
        fits = {name: _valid(richer, points, data, options) for name, richer, points in more(fit, data, names)}
        tried = {name: other for name, other in fits.items() if other is not None}
        earned = {name: float(fit.criteria.bic - other.criteria.bic) for name, other in tried.items()}
        best, ratios = _best(fit, tried, earned, pair)
        steps += [
            Step(k, name, float(other.criteria.bic), earned[name], name == best, ratios.get(name, np.nan))
            for name, other in tried.items()
        ]
        if best is None:
            break
        undecided += [(best, name) for name in tried if _close(best, name, earned)]
        fit = _shaken(tried[best], data, options)  # from beside its optimum the next part would make up for that
    kept = tuple(step.part for step in steps if step.kept)
    for _ in range(_ROUNDS if kept else 0):
        bic, fit = fit.criteria.bic, _shaken(fit, data, options, kept)
        if fit.criteria.bic > bic - MARGIN:
            break
    fit, dropped = pruned(fit, data, kept, MARGIN, options)
    if dropped:
        fit = _shaken(fit, data, options, remaining(kept, dropped))
    doubts = tuple((a, b) for a, b in undecided if b not in kept and a in remaining(kept, dropped))
    return Growth(fit, first, tuple(steps), dropped=dropped, undecided=doubts)


def _valid(chain: Chain, points: np.ndarray, data: IOData, options: dict[str, Any]) -> Fit | None:
    """The fit from these points; None if the chain diverges at every one of them."""
    try:
        return fit_chain(chain, data, start=points, **options)
    except (InputError, np.linalg.LinAlgError):  # a motor that runs away has derivatives too large for numbers
        return None


def _best(
    fit: Fit, tried: dict[str, Fit], earned: dict[str, float], pair: tuple[Fold, ...]
) -> tuple[str | None, dict[str, float]]:
    """The part that lowers BIC most among those that lower it enough and do no harm on unseen parts."""
    ratios: dict[str, float] = {}
    before: Unseen | None = None
    for name in sorted(earned, key=lambda name: -earned[name]):
        if earned[name] <= MARGIN:
            break
        if not pair:
            return name, ratios
        before = before or free_runs(fit.model, fit.theta, pair)
        if before.rms > _TELLING * float(np.sqrt(fit.criteria.mse)):
            return name, ratios  # the folds do not show what a joint needs, with this part or without it
        after = free_runs(tried[name].model, tried[name].theta, pair)
        ratios[name] = after.rms / before.rms
        if not harms(before, after, float(np.sqrt(tried[name].criteria.mse))):
            return name, ratios
    return None, ratios


def _close(best: str, name: str, earned: dict[str, float]) -> bool:
    """Whether the record does not tell the kept part from another one that is not a part of it, or it of that."""
    if name == best or PARTS[name].within(PARTS[best]) or PARTS[best].within(PARTS[name]):
        return False
    return earned[best] - earned[name] < CLOSE


def _shaken(fit: Fit, data: IOData, options: dict[str, Any], grown: tuple[str, ...] = ()) -> Fit:
    """The fit, or a better one from nearby starts: whether a stop is reached in time is discrete and blocks the search.

    Several `grown` parts are started again from their initial values, because each was added to a simpler joint.
    """
    chain, rng = fit.model, np.random.default_rng([options["seed"], len(fit.theta)])
    points = [np.clip(shaken(chain, fit.theta, rng), *chain.limits) for _ in range(_SHAKES)]
    if len(grown) > 1:
        points += [point for name in grown for point in again(name, fit, data)]
    return _better(fit, points + traded(chain, fit.theta), data, options, *(_LAST if grown else _USUAL))


def _better(
    fit: Fit, points: list[np.ndarray], data: IOData, options: dict[str, Any], glance: int = 4, finalists: int = 3
) -> Fit:
    """The fit, or that from the most promising points: `glance` iterations at each, the `finalists` to the end."""
    chain = fit.model
    run = Run(chain, data, Objective(), "lm", Options(max_iterations=glance).begun(), None)
    problems = with_curvature_weight(run, [run.problem(with_initial_states(chain, p, data)) for p in points])
    outcomes = [run.iterate(problem, problem.start, run.options) for problem in problems]
    order = np.argsort([o.cost for o in outcomes], kind="stable")[:finalists]
    leaders = [problems[k].thetas(outcomes[k].p)[0] for k in order if np.isfinite(outcomes[k].cost)]
    if not leaders:
        return fit
    other = _valid(chain, np.array(leaders), data, options)
    return other if other is not None and other.criteria.loss < fit.criteria.loss else fit


def _checked(
    growth: Growth, ends: Ends, data: IOData, pair: tuple[Fold, ...], starts: int, options: dict[str, Any]
) -> Growth:
    """The growth with what independent starts and unseen parts say of it."""
    fit, agreed, ways = growth.fit, 1, 0
    for k in range(1, _WAYS + 1):
        ways += 1
        try:
            other = _another(fit, ends, data, starts, {**options, "seed": options["seed"] + 1000 * k})
        except (InputError, np.linalg.LinAlgError):  # no start gives a valid model
            continue
        gap = float(other.criteria.bic - fit.criteria.bic)
        if abs(gap) <= MARGIN:
            agreed += 1
        elif gap < 0.0:
            agreed = 1
        if gap < -_BETTER:
            fit = other
        if agreed > 1:
            break
    seen = free_runs(fit.model, fit.theta, pair).percent if pair else float("nan")
    growth = replace(growth, fit=fit, agreed=agreed, unseen_percent=seen)
    return replace(growth, warnings=tuple(_warnings(growth, data, ways)))


def _another(fit: Fit, ends: Ends, data: IOData, starts: int, options: dict[str, Any]) -> Fit:
    """The same chain from a plain joint that was found from other starts."""
    bare = ends.fit.model
    found = fit_chain(bare, data, starts=starts, options=Options(max_iterations=40), **options)
    chain = fit.model
    own = set(chain.names) - set(bare.names)
    grown = {name: float(v) for name, v in zip(chain.names, fit.theta, strict=True) if name in own}
    rng = np.random.default_rng(options["seed"])
    base = lifted(bare, found.theta, chain, grown)
    points = [base, *(np.clip(shaken(chain, base, rng), *chain.limits) for _ in range(_SHAKES - 1))]
    run = fit_chain(chain, data, start=base[None], options=Options(max_iterations=1), **options)
    return _better(run, points, data, options)


def _warnings(growth: Growth, data: IOData, ways: int) -> list[str]:
    fit, said = growth.fit, []
    if growth.agreed < 2:
        said.append(
            f"only one of {1 + ways} independent starts came to this joint: a better one may exist; try --starts 20"
        )
    y = data.y[data.observed[:, 0], 0]
    seen = 100.0 * (1.0 - float(np.sqrt(fit.criteria.mse)) / max(float(np.std(y)), 1e-300))
    if growth.unseen_percent < seen - _LOST:
        said.append(
            f"on parts of the record that the joint was not fitted to, its fit is {growth.unseen_percent:.1f} % "
            f"instead of {seen:.1f} %: the record does not show often enough what decides its motion (arrivals at "
            "both ends, starts from rest); record longer, or try --split 0.7"
        )
    _, high = fit.model.at_limit(fit.theta)
    free = fit.model.free & ~fit.model.initial
    for name in (n for n, at in zip(fit.model.names, high & free, strict=True) if at and n.startswith("motor")):
        limit = dict(zip(fit.model.names, fit.theta, strict=True))[name]
        said.append(
            f"{name} is at its limit of {limit:g}: the structure does not suit the record; try --structure auto"
        )
    return said

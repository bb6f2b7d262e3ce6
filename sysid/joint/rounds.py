"""Rounds of growth within a time: in each every part is tried by a search from several points, and the best stays."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.joint_parts import shake_theta, trade_lag_for_delay
from sysid.estimation.objective import LEAST_SQUARES, Objective
from sysid.estimation.result import Fit
from sysid.estimation.search import SearchContext, set_curvature_weight
from sysid.joint.holdout import HoldoutErrors, holdout_errors, is_harmful
from sysid.joint.parts import PARTS, chains_with_another, restart_points
from sysid.model.chain import Chain
from sysid.selection.folds import Fold
from sysid.solver.iterate import Options

T = TypeVar("T")
SHAKES = 12  # places near an optimum that are tried
_SHORT_GLANCE, _LONG_GLANCE = (
    (4, 3),
    (15, 8),
)  # iterations at each of these places, and how many go on; for the whole joint
_FEW_POINTS = 3  # points beyond which only the best after a glance go on
# Three times what counts as very strong evidence (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995, section 3.2):
# residuals of a model that is not quite the joint are coloured, and BIC takes them as white.
MARGIN = 30.0
_UNDECIDED = 10.0  # difference of BIC between two parts that is no very strong evidence (the same source)
_JUDGING_ERROR = 2.0  # times the error over the whole record, up to which free runs over unseen parts can judge a part
_ROUND_SEARCH = Options(max_iterations=15)


class TimeIsUp(Exception):  # noqa: N818 - reads as what it says
    """The time is over; `Clock.within` catches it at the stage that it ends."""


@dataclass
class Clock:
    """`seconds` from now on; `left` are the stages that the time ended or left no place for, in order."""

    seconds: float = np.inf
    left: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._deadline = time.monotonic() + self.seconds

    @property
    def late(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self._deadline

    def hears(self, progress: Callable[[str], None] | None) -> Callable[[str], None] | None:
        """A progress that raises Late after the first search that ends too late.

        A search is short, and every fit tells each of its searches; so no fit has to know of the clock.
        """
        if self.seconds == np.inf:
            return progress

        def tell(text: str) -> None:
            if progress is not None:
                progress(text)
            if self.late:
                raise TimeIsUp

        return tell

    def within(self, stage: str, work: Callable[..., T], otherwise: T, *args: Any) -> T:
        """The result of `work(*args)`, or `otherwise` where the time does not suffice for this stage."""
        if not self.late:
            try:
                return work(*args)
            except TimeIsUp:
                pass
        self.left.append(stage)
        return otherwise

    def sentence(self) -> str:
        """What the time left out, and what to do; empty if nothing."""
        if not self.left:
            return ""
        *first_stages, last = dict.fromkeys(self.left)
        stages = f"{', '.join(first_stages)} and {last}" if first_stages else last
        return (
            f"growth was stopped after {self.seconds:g} s, before {stages}: a better "
            f"joint may exist; give it more time, for example --seconds {2.0 * self.seconds:g}"
        )


def search_from(
    chain: Chain, points: np.ndarray, data: IOData, options: dict[str, Any], limit: Options | None = None
) -> Fit | None:
    """The fit from these points (K, P); None if the chain diverges at every one of them."""
    if len(points) > _FEW_POINTS:
        points = best_points(chain, points, data, *_SHORT_GLANCE)
    if not len(points):
        return None
    try:
        return fit_chain(chain, data, start=points, options=limit, **options)
    except (InputError, np.linalg.LinAlgError):  # a motor that runs away has derivatives too large for numbers
        return None


def best_points(
    chain: Chain,
    points: np.ndarray,
    data: IOData,
    iterations: int,
    finalists: int,
    objective: Objective = LEAST_SQUARES,
) -> np.ndarray:
    """The best of these points (K, P) after a few iterations at each, the best first."""
    context = SearchContext(chain, data, objective, "lm", Options(max_iterations=iterations).begun(), None)
    problems = set_curvature_weight(context, [context.problem(with_initial_states(chain, p, data)) for p in points])
    outcomes = [context.iterate(problem, problem.start, context.options) for problem in problems]
    order = np.argsort([o.cost for o in outcomes], kind="stable")[:finalists]
    return np.array([problems[k].thetas(outcomes[k].p)[0] for k in order if np.isfinite(outcomes[k].cost)])


def refine_from(
    fit: Fit, points: list[np.ndarray], data: IOData, options: dict[str, Any], glance: int = 4, finalists: int = 3
) -> Fit:
    """The fit, or that from the most promising points: `glance` iterations at each, the `finalists` to the end."""
    leaders = best_points(fit.model, np.array(points), data, glance, finalists)
    other_fit = search_from(fit.model, leaders[:finalists], data, options)
    return other_fit if other_fit is not None and other_fit.criteria.loss < fit.criteria.loss else fit


def search_nearby(fit: Fit, data: IOData, options: dict[str, Any], grown: tuple[str, ...] = ()) -> Fit:
    """The fit, or a better one from nearby starts: whether a stop is reached in time is discrete and blocks the search.

    Several `grown` parts are started again from their initial values, because each was added to a simpler joint.
    """
    chain, rng = fit.model, np.random.default_rng([options["seed"], len(fit.theta)])
    points = [np.clip(shake_theta(chain, fit.theta, rng), *chain.limits) for _ in range(SHAKES)]
    if len(grown) > 1:
        points += [point for name in grown for point in restart_points(name, fit, data)]
    return refine_from(
        fit, points + trade_lag_for_delay(chain, fit.theta), data, options, *(_LONG_GLANCE if grown else _SHORT_GLANCE)
    )


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


def grow_rounds(
    fit: Fit, data: IOData, pair: tuple[Fold, ...], names: tuple[str, ...], options: dict[str, Any], clock: Clock
) -> tuple[Fit, tuple[Step, ...], tuple[tuple[str, str], ...]]:
    """The grown fit, the parts tried, and pairs (kept, other) of parts that the record does not tell apart.

    A round that the clock ends does not count: parts are judged beside each other.
    """
    steps: list[Step] = []
    undecided_pairs: list[tuple[str, str]] = []
    no_fits: dict[str, Fit] = {}
    k = 0
    while True:
        fits_with_part = clock.within("every part was tried", _search_round, no_fits, fit, data, names, options)
        reductions = {
            name: float(fit.criteria.bic - other_fit.criteria.bic) for name, other_fit in fits_with_part.items()
        }
        best, ratios = _best_part(fit, fits_with_part, reductions, pair)
        steps += [
            Step(k, name, float(other_fit.criteria.bic), reductions[name], name == best, ratios.get(name, np.nan))
            for name, other_fit in fits_with_part.items()
        ]
        if best is None:
            return fit, tuple(steps), tuple(undecided_pairs)
        undecided_pairs += [(best, name) for name in fits_with_part if _is_undecided(best, name, reductions)]
        k += 1
        last = (fits_with_part[best].model, fits_with_part[best].theta[None], data, options)
        fit = clock.within("every part was tried", search_from, None, *last) or fits_with_part[best]


def _search_round(fit: Fit, data: IOData, names: tuple[str, ...], options: dict[str, Any]) -> dict[str, Fit]:
    """The fits with one more part, by its name."""
    fits_with_part: dict[str, Fit] = {}
    for name, chain, points in chains_with_another(fit, data, names):
        other_fit = search_from(chain, points, data, options, _ROUND_SEARCH)
        if other_fit is not None:
            fits_with_part[name] = other_fit
    return fits_with_part


def _best_part(
    fit: Fit, fits_with_part: dict[str, Fit], reductions: dict[str, float], pair: tuple[Fold, ...]
) -> tuple[str | None, dict[str, float]]:
    """The part that lowers BIC most among those that lower it enough and do no harm on unseen parts."""
    ratios: dict[str, float] = {}
    errors_without: HoldoutErrors | None = None
    for name in sorted(reductions, key=lambda name: -reductions[name]):
        if reductions[name] <= MARGIN:
            break
        if not pair:
            return name, ratios
        errors_without = errors_without or holdout_errors(fit.model, fit.theta, pair)
        if errors_without.rms > _JUDGING_ERROR * float(np.sqrt(fit.criteria.mse)):
            return name, ratios  # the folds do not show what a joint needs, with this part or without it
        errors_with = holdout_errors(fits_with_part[name].model, fits_with_part[name].theta, pair)
        ratios[name] = errors_with.rms / errors_without.rms
        if not is_harmful(errors_without, errors_with, float(np.sqrt(fits_with_part[name].criteria.mse))):
            return name, ratios
    return None, ratios


def _is_undecided(best: str, name: str, reductions: dict[str, float]) -> bool:
    """Whether the record does not tell the kept part from another one that is not a part of it, or it of that."""
    if name == best or PARTS[name].within(PARTS[best]) or PARTS[best].within(PARTS[name]):
        return False
    return reductions[best] - reductions[name] < _UNDECIDED

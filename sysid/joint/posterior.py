"""A joint with all its parts at once: what the record does not show stays at what is usual.

A record seldom settles whether a joint has a part, and a part that is left out is taken for zero: friction at rest, for
example, which every joint has. So the most likely joint is found under the priors of `sysid.joint.prior` (maximum a
posteriori), with few starts. Which parts the record shows is a question to the posterior (`sysid.joint.parts`).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.base.handlers import Shown, handler
from sysid.base.limits import MORE_STARTS
from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.joint_parts import lift_theta, sub
from sysid.estimation.objective import LEAST_SQUARES, Objective
from sysid.estimation.result import Fit
from sysid.estimation.starts import starts as make_starts
from sysid.joint.clock import Clock
from sysid.joint.ends import WORDS as ENDS_IN_WORDS
from sysid.joint.ends import choose_ends, present_ends, straight_for
from sysid.joint.evidence import stop_tests
from sysid.joint.full import PARTS, at_rest, best_points, colour_level, full_joint, is_plain, loose_linkage
from sysid.joint.holdout import holdout_errors, holdout_folds
from sysid.joint.occam import log_odds_of_bends, log_odds_of_parts
from sysid.joint.parts import PartEvidence, parts_of
from sysid.joint.physics import ends_of, travel_of
from sysid.joint.prior import joint_objective, units_of, usual_values
from sysid.joint.sampling import ENOUGH_SAMPLES, chain_at_rate, cut_at_rests, theta_at_rate, thin, thinning_factor
from sysid.joint.starting_points import places_around, plays_of, starting_points, steps_from
from sysid.model.chain import Chain
from sysid.motor_parts import TABLE
from sysid.structures import actuated_joint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEADERS = 4  # starting points of a round after the first that are searched to the end
_ROUNDS = 5  # over the whole record, at most
_FIRST_LEVEL = 3.0  # of the noise in the first search, by the residuals of the plain joint
_SAME = np.log(20.0)  # searches whose ends have a posterior within odds of 20 to 1 came to one joint
_UNSEEN_LOSS = 3.0  # points of fit on unseen parts that a warning speaks of


@dataclass(frozen=True, repr=False)
class JointFit(Shown):
    """The most likely joint, with what its record shows of its end stops and its parts.

    `ends`: the end stops of the model ("none", "straight", "lower", "upper", "both"; see `sysid.joint.ends`); `unmet`
    are those, "end_low" and "end_high", at which the joint never rests in the record. `parts`: each part beside what is
    usual (see `sysid.joint.parts`). `agreed` of `tried` searches from independent starts came to this joint;
    `unseen_percent` is its free-run fit [%] on parts of the record that it was not fitted to. `log_odds` are those of
    the joint with all parts against the plain one; below 0 the fit is the plain one (`sysid.joint.occam`). `warnings`
    are sentences for a report; `stopped` is the one of them that says what the time left out, empty if nothing.
    """

    fit: Fit
    ends: str
    parts: tuple[PartEvidence, ...]
    agreed: int = 1
    tried: int = 1
    unseen_percent: float = float("nan")
    unmet: tuple[str, ...] = ()
    log_odds: float = 0.0
    warnings: tuple[str, ...] = field(default=())
    stopped: str = ""

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the parameters whose parts the record shows."""
        return tuple(part.name for part in self.parts if part.verdict == "shown")

    def sentence(self) -> str:
        """What the record shows of the parts, in words."""
        shown = [part.words for part in self.parts if part.verdict == "shown"]
        absent = [part.words for part in self.parts if part.verdict == "absent"]
        open_ = [part.words for part in self.parts if part.verdict == "open"]
        sentences = [f"The record shows {_listed(shown)}." if shown else ""]
        sentences += [f"It shows that there is {_listed([f'no {words}' for words in absent])}." if absent else ""]
        sentences += [f"It leaves open {_listed(open_)}." if open_ else ""]
        if self.log_odds < 0.0:
            odds = np.exp(min(-self.log_odds, np.log(1e5)))
            odds = round(odds, -max(int(np.log10(odds)) - 1, 0))
            sentences.append(
                f"A joint without these parts is likelier, by odds of {odds:,.0f} to 1, and the model is that."
            )
        if self.ends != "both" and not self.unmet:
            sentences.append(f"The record shows {ENDS_IN_WORDS[self.ends]}.")
        if self.unmet:
            ends = _listed([f"{'lower' if name == 'end_low' else 'upper'} end" for name in self.unmet])
            sentences.append(f"The model's {ends} may lie farther out: the joint never rests there.")
        return " ".join(filter(None, sentences))

    def plot(self) -> "Figure":
        """A figure of the parts, each beside what is usual. Raises InputError for a joint without parts."""
        figure: Figure = handler(self).plot(self)
        return figure

    def as_dict(self) -> dict[str, Any]:
        """What the record shows, ready for JSON."""
        unseen = self.unseen_percent if np.isfinite(self.unseen_percent) else None
        return {
            "ends": self.ends,
            "unmet": list(self.unmet),
            "log_odds": self.log_odds,
            "parts": [part.as_dict() for part in self.parts],
            "agreed": self.agreed,
            "tried": self.tried,
            "unseen_percent": unseen,
        }


def _listed(words: list[str], link: str = "and") -> str:
    *first, last = words
    return f"{', '.join(first)} {link} {last}" if first else last


@checked(late=True)
def fit_joint(
    data: IOData,
    plain: Chain | None = None,
    search: str = "lm",
    starts: int = 5,
    seed: int = 0,
    parts: Iterable[str] = PARTS,
    progress: Callable[[str], None] | None = None,
    seconds: float = np.inf,
) -> JointFit:
    """The most likely actuated joint with all parts, for `data` and the priors of `sysid.joint.prior`.

    `plain` is the joint without parts: an `actuated_joint` or `servo_joint` with a motor, without Stribeck friction,
    loss, jam and backlash. What it fixes and bounds stays. Its end stops are chosen first (`sysid.joint.ends`), then
    all `parts` of it (`sysid.joint.full.full_joint`) are searched together. search, starts (of the plain joint), seed
    and progress are those of `sysid.fit`. After `seconds` the search ends with what it has, at the least a plain joint
    fitted to the record, and `warnings` say what it left out. Raises InputError for another chain or part, for seconds
    that are not positive, and the errors of `sysid.fit`.
    """
    names, chain = tuple(parts), actuated_joint(play=False) if plain is None else plain
    for name in names:
        if name not in (*PARTS, *TABLE):
            raise unknown("part of a joint", name, (*PARTS, *TABLE))
    if not is_plain(chain):
        raise InputError("fit_joint begins with a plain actuated_joint; leave Stribeck, loss, jam and play out")
    if not seconds > 0.0:
        raise InputError(f"seconds is {seconds:g}; give a positive number, or leave it out")
    clock = Clock(seconds)
    options: dict[str, Any] = {"search": search, "seed": seed, "progress": progress}
    timed = {**options, "progress": clock.hears(progress)}
    # A motor that does not suit runs away.
    with one_blas_thread(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        chain = straight_for(chain.scaled(data.u, data.y), data)
        k = thinning_factor(data, chain)
        rough = thin(data, k)
        which, plain_fit = _plain_joint(chain, rough, starts, "turns" in names, options, timed, clock)
        search_all = _Search(plain_fit, rough, data, k, names, timed)
        found = clock.within("its parts were searched", search_all.best, None)
        full, agreed, tried = (_at_rate(plain_fit, data, k, options), 1, 1) if found is None else found
        fit, odds = full, 0.0
        if found is not None:
            fit, odds = clock.within("a joint without parts was tried", search_all.likelier, (full, 0.0), full)
        fit.remember(data)
        pair = holdout_folds(data)
        unseen = holdout_errors(fit.model, fit.theta, pair, fit.prior).percent if pair else float("nan")
        shown = parts_of(full, data)
        unmet = _unmet_ends(fit, data)
    result = JointFit(fit, which, shown, agreed, tried, unseen, unmet, odds, stopped=clock.sentence())
    return replace(result, warnings=tuple(_warnings(result, data)))


def _plain_joint(
    chain: Chain, data: IOData, starts: int, turns: bool, options: dict[str, Any], timed: dict[str, Any], clock: Clock
) -> tuple[str, Fit]:
    """The end stops that the record shows, and the joint with these, without parts, over the whole record."""
    stretches = cut_at_rests(data, chain)
    points = make_starts(chain, data, starts, options["seed"])
    with_stops = fit_chain(chain, stretches, start=np.array(points), **options)
    arguments = (with_stops, data, stretches, holdout_folds(stretches), timed, turns)
    which, fit = clock.within("its end stops were chosen", choose_ends, present_ends(with_stops), *arguments)
    if stretches is not data:
        own_points = np.array([fit.theta, *make_starts(fit.model, data, starts, options["seed"])])
        fit = fit_chain(fit.model, data, start=own_points, **options)
    return which, fit


def _at_rate(fit: Fit, data: IOData, k: int, options: dict[str, Any], objective: Objective = LEAST_SQUARES) -> Fit:
    """The fit, to a record with k samples as one, over the whole record."""
    if k == 1 and objective is LEAST_SQUARES:
        return fit
    start = theta_at_rate(fit.model, fit.theta, k)[None]
    return fit_chain(chain_at_rate(fit.model, k), data, start=start, objective=objective, **options)


@dataclass
class _Search:
    """The search of a joint with all parts from the plain one, fitted to `rough`: `data` with k samples as one."""

    plain: Fit
    rough: IOData
    data: IOData
    k: int
    parts: tuple[str, ...]
    options: dict[str, Any]

    def best(self) -> tuple[Fit, int, int] | None:
        """The fit, how many searches from the best points came to it, and of how many.

        None where no joint with parts is a model, of a record that no motor made.
        """
        try:
            return self._best()
        except (InputError, np.linalg.LinAlgError):  # derivatives too large for numbers
            return None

    def _best(self) -> tuple[Fit, int, int]:
        """Over stretches, with k samples as one, round by round until one brings nothing; then over all samples."""
        plain, rough, k = self.plain, self.rough, self.k
        rng = np.random.default_rng([self.options["seed"], len(plain.theta)])
        full, units = full_joint(plain.model, rough, self.parts), units_of(plain.model, plain.theta, rough)
        points = np.array(list(starting_points(plain, full, usual_values(full, units), rough, rng)))
        stretches = cut_at_rests(rough, plain.model)
        first = full if stretches is rough else at_rest(full)
        objective = joint_objective(first, units, _FIRST_LEVEL * float(np.sqrt(plain.criteria.mse)))
        # All go on for some iterations: on 4 of 8 drawn legs the best was not among the first four after two.
        fit = fit_chain(first, stretches, start=points, objective=objective, **self.options)
        fit, level = self._rounds(full, fit, stretches, units, rng)
        loose = loose_linkage(full)
        if loose != full:
            objective = joint_objective(loose, units, level)
            start = lift_theta(full, fit.theta, loose, {})[None]
            free = fit_chain(loose, rough, start=start, objective=objective, **self.options)
            if log_odds_of_bends(free, fit, rough, colour_level(fit, rough)) > _SAME:
                again = np.array([free.theta, *(lift_theta(full, point, loose, {}) for point in points)])
                full, fit = loose, fit_chain(loose, rough, start=again, objective=objective, **self.options)
                fit, level = self._rounds(full, fit, rough, units, rng)
        ends, starts = fit, list[np.ndarray]()
        data, at_rate = self.data, chain_at_rate(plain.model, k)
        units = units_of(at_rate, theta_at_rate(plain.model, plain.theta, k), data)
        if k > 1:
            fit = _at_rate(fit, data, k, self.options, joint_objective(chain_at_rate(full, k), units, level))
            places = places_around(fit, data, colour_level(fit, data), rng)
            part, level = data.portion(2 * ENOUGH_SAMPLES), float(np.sqrt(fit.criteria.mse))
            nearer = self._round(fit.model, np.array(places), part, units, level, fit.theta)
            starts.append(estimate_initial(fit.model, nearer.theta, data))
        objective = joint_objective(fit.model, units, colour_level(fit, data))
        fit = fit_chain(fit.model, data, start=np.array([fit.theta, *starts]), objective=objective, **self.options)
        if k > 1:  # a strike at a stop more or fewer, with fewer samples, is a step that no search goes back
            level = colour_level(fit, data)
            places = places_around(fit, data, level, rng)
            ends = fit = self._round(fit.model, np.array(places), data, units, level, fit.theta)
        heights = 0.5 * ends.criteria.N / ends.criteria.mse * (np.array(ends.losses) - min(ends.losses))
        return fit, int(np.sum(heights <= _SAME)), len(heights)

    def likelier(self, full: Fit) -> tuple[Fit, float]:
        """The joint with all parts, or the plain one where that is likelier, and the logarithm of the odds."""
        level, at_rate = colour_level(full, self.data), chain_at_rate(self.plain.model, self.k)
        begins = {name: value for name, value in at_rate.fixed.items() if not name.endswith(".v0")}  # as the full one
        linkage = travel_of(full.model)  # its bends are no part
        blocks = tuple(linkage if linkage and b is travel_of(at_rate) else b for b in at_rate.blocks)
        at_rate = sub(replace(at_rate, fixed=begins), blocks)
        start = lift_theta(self.plain.model, theta_at_rate(self.plain.model, self.plain.theta, self.k), at_rate, {})
        objective = joint_objective(at_rate, units_of(at_rate, start, self.data), level)
        points = np.array([start, lift_theta(full.model, full.theta, at_rate, {})])
        plain = fit_chain(at_rate, self.data, start=points, objective=objective, **self.options)
        odds = log_odds_of_parts(full, plain, self.data, level)
        return (plain if odds < 0.0 else full), odds

    def _rounds(
        self, full: Chain, fit: Fit, seen: IOData, units: dict[str, float], rng: np.random.Generator
    ) -> tuple[Fit, float]:
        """Rounds over the whole record from a fit to `seen`, until one brings nothing, and the noise's deviation."""
        rough, before, level = self.rough, np.inf, float(np.sqrt(fit.criteria.mse))
        for _ in range(_ROUNDS):
            shaken = places_around(fit, seen, colour_level(fit, seen), rng)
            others = [lift_theta(full, fit.theta, full, play) for play in plays_of(full, fit.theta, rough, rng)]
            others += steps_from(full, fit.theta, usual_values(full, units), rough)
            fit = self._round(full, np.array([*shaken, *others]), rough, units, level, fit.theta)
            level, seen = min(level, float(np.sqrt(fit.criteria.mse))), rough
            if 0.5 * rough.N / level**2 * (before - fit.criteria.mse) < _SAME:
                break
            before = fit.criteria.mse
        return fit, level

    def _round(
        self,
        chain: Chain,
        points: np.ndarray,
        data: IOData,
        units: dict[str, float],
        level: float,
        last: np.ndarray,
    ) -> Fit:
        """The fit from the best of these points, and from `last`: a round does not end worse than the one before."""
        objective = joint_objective(chain, units, level)
        leaders = np.array([last, *best_points(chain, points, data, _LEADERS - 1, objective)])
        return fit_chain(chain, data, start=leaders, objective=objective, **self.options)


def _unmet_ends(fit: Fit, data: IOData) -> tuple[str, ...]:
    """The end stops of the model at which the joint never rests in its record."""
    tests = stop_tests(fit, data)
    ends = zip(("end_low", "end_high"), ends_of(fit.model, fit.theta), strict=True)
    return tuple(name for name, end in ends if np.isfinite(end) and not tests[name].met)


def _warnings(joint: JointFit, data: IOData) -> Iterator[str]:
    fit = joint.fit
    if joint.stopped:
        yield joint.stopped
    elif joint.agreed < 2 <= joint.tried:
        yield (
            f"only one of the last {joint.tried} searches led to this joint, so a better one may exist; try --starts "
            f"{MORE_STARTS}"
        )
    y = data.y[data.observed[:, 0], 0]
    percent = 100.0 * (1.0 - float(np.sqrt(fit.criteria.mse)) / max(float(np.std(y)), 1e-300))
    if joint.unseen_percent < percent - _UNSEEN_LOSS:
        yield (
            f"on parts of the record that the joint was not fitted to, its fit is {joint.unseen_percent:.1f} % instead "
            f"of {percent:.1f} %: the record does not show often enough what decides its motion (arrivals at both "
            "ends, starts from rest); record longer, or try --split 0.7"
        )
    _, high = fit.model.at_limit(fit.theta)
    held_up = high & fit.model.free & ~fit.model.initial
    for name, value in zip(np.array(fit.model.names)[held_up], fit.theta[held_up], strict=True):
        if name.endswith(".loss"):
            yield "the record does not tell the friction of the screw from its load; their sum is what counts"
        elif name.startswith("motor"):
            yield f"{name} is at its limit of {value:g}: the structure does not suit the record; try --structure auto"

"""An actuated joint with as much physics as the record supports: parts are added one by one while they help."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.base.handlers import Shown, handler
from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.joint_parts import lift_theta, shake_theta
from sysid.estimation.result import Fit
from sysid.estimation.starts import starts as make_starts
from sysid.joint.ends import WORDS as ENDS_IN_WORDS
from sysid.joint.ends import Ends, choose_ends, present_ends
from sysid.joint.holdout import holdout_errors, holdout_folds
from sysid.joint.parts import PARTS, is_plain, prune, remaining_parts
from sysid.joint.rounds import MARGIN, SHAKES, Clock, Step, grow_rounds, refine_from, search_nearby
from sysid.joint.sampling import chain_at_rate, cut_at_rests, theta_at_rate, thin, thinning_factor
from sysid.model.chain import Chain
from sysid.selection.folds import Fold
from sysid.solver.iterate import Options
from sysid.structures import actuated_joint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORDS = {name: part.words for name, part in PARTS.items()}
_ROUNDS = 4  # at most, of the last search, as long as each lowers BIC by MARGIN
_CONFIRMATIONS = 2  # starts anew, at most, to come to the same joint
_SAME_OPTIMUM = 1.0  # of BIC, less than which is the same optimum reached to another tolerance
_NEARBY_SEARCH = "places nearby were searched"
_UNSEEN_LOSS = 3.0  # points of fit on unseen parts that a warning speaks of


@dataclass(frozen=True, repr=False)
class Growth(Shown):
    """The resulting joint, BIC of the plain joint, and the parts tried, in order.

    `ends` says which end stops the record shows ("none", "straight", "lower", "upper", "both"; see
    `sysid.joint.ends`). `dropped` are the parts that were kept, and that the grown joint does without. `undecided`
    names parts that the record does not tell apart from a kept one. `agreed` counts independent starts that came to
    this joint; `unseen_percent` is its free-run fit [%] on parts of the record that it was not fitted to. `warnings`
    are sentences for a report; `stopped` is the one of them that says what the time left out, empty if nothing.
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
    stopped: str = ""

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts that the joint has."""
        return remaining_parts(tuple(step.part for step in self.steps if step.kept), self.dropped)

    def stayed(self, step: Step) -> bool:
        """Whether the part of a step was kept in its round, and the grown joint has the whole of it."""
        return step.kept and remaining_parts((step.part,), self.dropped) == (step.part,)

    def sentence(self) -> str:
        """The parts kept, in words."""
        stops = "" if self.ends == "both" else f" The record shows {ENDS_IN_WORDS[self.ends]}."
        if not self.parts:
            return (
                "No part other than dry friction and a position-dependent load improves BIC enough on this record."
                + stops
            )
        steps = [
            (name, step.bic) for step in self.steps if step.kept for name in remaining_parts((step.part,), self.dropped)
        ]
        kept_words = [f"{WORDS[name]} (BIC {bic:.0f})" for name, bic in steps]
        doubt = "".join(
            f" The record does not tell {WORDS[kept_words]} from {WORDS[other_part]}."
            for kept_words, other_part in self.undecided
        )
        return (
            f"Besides dry friction and a position-dependent load (BIC {self.plain_bic:.0f}), the joint has "
            f"{' and '.join(kept_words)}." + doubt + stops
        )

    def plot(self) -> "Figure":
        """A figure of the parts tried, round by round: by how much each lowered BIC, and which stayed.

        Raises InputError where no part was tried.
        """
        figure: Figure = handler(self).plot(self)
        return figure

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


@dataclass(frozen=True)
class _ThinRecord:
    """The record with k samples as one, and that in stretches."""

    whole: IOData
    cut: IOData
    k: int


@checked(late=True)
def grow_joint(
    data: IOData,
    plain: Chain | None = None,
    search: str = "lm",
    starts: int = 4,
    seed: int = 0,
    parts: Iterable[str] = tuple(PARTS),
    progress: Callable[[str], None] | None = None,
    seconds: float = np.inf,
) -> Growth:
    """Fit an actuated joint to `data` and repeatedly add the part that lowers BIC most, as long as one does.

    Parts: "stribeck" (friction that falls with speed), "sided" (friction at rest that differs by direction), "sticks"
    (both), "loss" (screw friction proportional to the load), "jams" (the motor jams at an end stop), "screw" (both),
    "plays" (backlash), "coasts" (backlash whose link has inertia and weight), "turns" (a load that repeats every turn
    of a joint without travel map, as a pendulum's). Each part starts from the current fit, must lower BIC by `MARGIN`,
    and must not do harm in free run over parts of the record that it was not fitted to. The end stops are chosen first,
    by the same rules. `plain` is the initial joint, an `actuated_joint` with a motor and without those parts or
    backlash; search, starts, seed and progress are those of `sysid.fit`. After `seconds` growth ends with what it has,
    at the least a plain joint fitted to the whole record, and `warnings` say what it left out. Raises InputError for an
    unsuitable part or plain joint, for seconds that are not positive, and the errors of `sysid.fit`.
    """
    names = tuple(parts)
    for part in names:
        if part not in PARTS:
            raise unknown("part of a joint", part, PARTS)
    if not seconds > 0.0:
        raise InputError(f"seconds is {seconds:g}; give a positive number, or leave it out")
    chain = actuated_joint(play=False) if plain is None else plain
    if not is_plain(chain):
        raise InputError("grow_joint begins with a plain actuated_joint; leave Stribeck, loss, jam and play out")
    options: dict[str, Any] = {"search": search, "seed": seed, "progress": progress}
    # A motor that does not suit runs away.
    with one_blas_thread(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _grow(chain.scaled(data.u, data.y), data, starts, names, options, Clock(seconds))


def _grow(
    chain: Chain, data: IOData, starts: int, names: tuple[str, ...], options: dict[str, Any], clock: Clock
) -> Growth:
    """Ends and parts on the record in stretches, of a long one with fewer samples; then the whole record.

    The plain joint and the fit to the whole record are made whatever the time, so that there is a result.
    """
    timed_options = {**options, "progress": clock.hears(options["progress"])}
    k = thinning_factor(data, chain)
    rough = thin(data, k)
    stretches, pair = cut_at_rests(rough, chain), holdout_folds(data)
    short = holdout_folds(stretches)
    fit_with_stops = _fit_plain(chain, rough, stretches, starts, options)
    arguments = (fit_with_stops, rough, stretches, short, MARGIN, timed_options, names)
    ends = clock.within("its end stops were chosen", choose_ends, present_ends(fit_with_stops), *arguments)
    # Over stretches a search seldom stops beside its optimum.
    plain = (
        clock.within(_NEARBY_SEARCH, search_nearby, ends.fit, ends.fit, stretches, timed_options)
        if stretches is rough
        else ends.fit
    )
    fit, steps, undecided = grow_rounds(plain, stretches, short, names, timed_options, clock)
    kept_parts = tuple(step.part for step in steps if step.kept)
    first = float(ends.fit.criteria.bic)
    try:
        whole_fit = _fit_whole_record(fit, data, k, options)
    except InputError:  # it runs away over the whole record, which stretches do not show
        whole_fit, steps, kept_parts = (
            fit_chain(chain_at_rate(ends.fit.model, k), data, starts=starts, **options),
            (),
            (),
        )
    fit = clock.within(_NEARBY_SEARCH, search_nearby, whole_fit, whole_fit, data, timed_options, kept_parts)
    uncut: tuple[Fit, tuple[str, ...]] = fit, ()
    fit, dropped = clock.within("parts were left out again", prune, uncut, fit, data, kept_parts, MARGIN, timed_options)
    parts_left = remaining_parts(kept_parts, dropped)
    for turn in range(_ROUNDS):
        bic, fit = (
            fit.criteria.bic,
            clock.within(_NEARBY_SEARCH, search_nearby, fit, fit, data, timed_options, parts_left if turn else ()),
        )
        if fit.criteria.bic > bic - MARGIN:
            break
    doubts = tuple((a, b) for a, b in undecided if b not in kept_parts and a in parts_left)
    growth = Growth(fit, first, steps, ends=ends.which, dropped=dropped, undecided=doubts)
    return _confirm(growth, ends, data, _ThinRecord(rough, stretches, k), pair, starts, timed_options, clock)


def _fit_plain(chain: Chain, data: IOData, cut: IOData, starts: int, options: dict[str, Any]) -> Fit:
    """The plain joint, from starts that the whole record gives."""
    if cut is data:
        return fit_chain(chain, data, starts=starts, **options)
    points = make_starts(chain, data, starts, options["seed"])
    return fit_chain(chain, cut, start=np.array(points), **options)


def _fit_whole_record(fit: Fit, data: IOData, k: int, options: dict[str, Any]) -> Fit:
    """The fit, with k samples as one, over the whole record."""
    return fit_chain(chain_at_rate(fit.model, k), data, start=theta_at_rate(fit.model, fit.theta, k)[None], **options)


def _confirm(
    growth: Growth,
    ends: Ends,
    data: IOData,
    rough: _ThinRecord,
    pair: tuple[Fold, ...],
    starts: int,
    options: dict[str, Any],
    clock: Clock,
) -> Growth:
    """The growth with what independent starts and unseen parts say of it."""
    fit, agreed, ways = growth.fit, 1, 0
    for k in range(1, _CONFIRMATIONS + 1):
        ways += 1
        try:
            arguments = (fit, ends, data, rough, starts, {**options, "seed": options["seed"] + 1000 * k})
            other_fit = clock.within("other starts confirmed it", _fit_again, None, *arguments)
        except (InputError, np.linalg.LinAlgError):  # no start gives a valid model
            continue
        if other_fit is None:
            break
        gap = float(other_fit.criteria.bic - fit.criteria.bic)
        if abs(gap) <= MARGIN:
            agreed += 1
        elif gap < 0.0:
            agreed = 1
        if gap < -_SAME_OPTIMUM:
            fit = other_fit
        if agreed > 1:
            break
    unseen_percent = holdout_errors(fit.model, fit.theta, pair).percent if pair else float("nan")
    growth = replace(growth, fit=fit, agreed=agreed, unseen_percent=unseen_percent, stopped=clock.sentence())
    growth.fit.remember(data)
    return replace(growth, warnings=tuple(_warnings(growth, data, ways)))


def _fit_again(fit: Fit, ends: Ends, data: IOData, rough: _ThinRecord, starts: int, options: dict[str, Any]) -> Fit:
    """The same chain from a plain joint that was found from other starts."""
    plain_chain, stretches = ends.fit.model, rough.cut
    plain_fit = _fit_plain(plain_chain, rough.whole, stretches, starts, options)
    chain, theta = chain_at_rate(fit.model, 1.0 / rough.k), theta_at_rate(fit.model, fit.theta, 1.0 / rough.k)
    grown_names = set(chain.names) - set(plain_chain.names)
    grown_values = {name: float(v) for name, v in zip(chain.names, theta, strict=True) if name in grown_names}
    rng = np.random.default_rng(options["seed"])
    base = lift_theta(plain_chain, plain_fit.theta, chain, grown_values)
    points = [base, *(np.clip(shake_theta(chain, base, rng), *chain.limits) for _ in range(SHAKES - 1))]
    run = fit_chain(chain, stretches, start=base[None], options=Options(max_iterations=1), **options)
    return _fit_whole_record(refine_from(run, points, stretches, options), data, rough.k, options)


def _warnings(growth: Growth, data: IOData, ways: int) -> list[str]:
    fit, sentences = growth.fit, [growth.stopped] if growth.stopped else []
    if growth.agreed < 2 and not growth.stopped:
        sentences.append(
            f"only one of {1 + ways} independent starts led to this joint, so a better one may exist; try --starts 20"
        )
    y = data.y[data.observed[:, 0], 0]
    fit_percent = 100.0 * (1.0 - float(np.sqrt(fit.criteria.mse)) / max(float(np.std(y)), 1e-300))
    if growth.unseen_percent < fit_percent - _UNSEEN_LOSS:
        sentences.append(
            f"on parts of the record that the joint was not fitted to, its fit is {growth.unseen_percent:.1f} % "
            f"instead of {fit_percent:.1f} %: the record does not show often enough what decides its motion "
            "(arrivals at "
            "both ends, starts from rest); record longer, or try --split 0.7"
        )
    _, high = fit.model.at_limit(fit.theta)
    free = fit.model.free & ~fit.model.initial
    for name in (
        n for n, at_limit in zip(fit.model.names, high & free, strict=True) if at_limit and n.startswith("motor")
    ):
        limit = dict(zip(fit.model.names, fit.theta, strict=True))[name]
        if name.endswith(".loss"):
            sentences.append(
                "the record does not tell the friction of the screw from its load; their sum is what counts"
            )
            continue
        sentences.append(
            f"{name} is at its limit of {limit:g}: the structure does not suit the record; try --structure auto"
        )
    return sentences

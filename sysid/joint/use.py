"""Design for use: the parts of an experiment that shrink the band of a joint's free run over an input of the user's.

The mean variance of the free run over that input is what the next experiment is to lower, for each second that the rig
takes (V-optimality: Atkinson, Donev and Tobias, Optimum Experimental Designs, Oxford 2007, chapter 10). Parts are added
one by one, each the one that lowers it most for its time; what a part tells is known from the fit to first order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, number
from sysid.data.record import IOData
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.clock import Clock
from sysid.joint.course import SHORT_OF, Course, stops_met
from sysid.joint.transfer import joint_information
from sysid.model.chain import Chain

MOST_TIME = 600.0  # s of the rig
_MOST_SAMPLES = 20_000  # of the experiment: each part is tried behind all of them
_PIECE = 15.0  # s of the input of use that the rig plays as one part
_PIECES = 6  # places in the input of use that are tried
_ENOUGH = 1.0 / 3.0  # of a reading's noise: beside it such a deviation widens what is seen by a twentieth
_WORTH = 0.02  # of the variance, for a minute: a part that brings less is not worth its time

Part = Callable[[], None]


@dataclass(frozen=True)
class Use:
    """The standard deviation of the free run over the input u (N,) of use, `now` and `then` (N,) [y], every Ts [s].

    `steps`: time of the rig [s] and deviation on the mean [y] after each part of the experiment, from nothing on.
    """

    u: np.ndarray
    Ts: float
    now: np.ndarray
    then: np.ndarray
    steps: tuple[tuple[float, float], ...]

    @property
    def deviations(self) -> tuple[float, float]:
        """On the mean over the input, now and then [y]."""
        return self.steps[0][1], self.steps[-1][1]


class UseBand:
    """The band over an input of use from the information of a record, and from that of more parts of an experiment."""

    def __init__(self, fit: Fit, data: IOData, u: np.ndarray, course: Course) -> None:
        chain, info = fit.model, joint_information(fit, data)
        factor = info.factor[info.own]
        still = np.array(fit.theta)
        still[chain.names.index(f"{motor_of(chain).role}.v0")] = 0.0
        with np.errstate(all="ignore"):
            self.run, J = chain.tangent(still, u)
        self.places, met = data.y[data.observed[:, 0], 0], stops_met(fit, data)
        self.open = [course.output_way(way) for way in (-1, 1) if course.may_meet[way] and not met[way]]
        self.seen = _from_known_place(chain, J) @ factor
        self.factor, self.level = factor, float(np.sqrt(info.noise_variance))
        self.course, self.gathered = course, np.eye(factor.shape[1])

    def gathers(self, first: int) -> np.ndarray:
        """Information (r, r) in units of the factor's columns with the course's samples from `first` on."""
        tells = _from_known_place(self.course.chain, self.course.sensitivity()) @ self.factor / self.level
        return self.gathered + tells[first:].T @ tells[first:]

    def deviation(self, gathered: np.ndarray) -> np.ndarray:
        """Standard deviation (N,) [y] over the input of use.

        Where no stop was met and the joint may run into one, it may be anywhere between what was seen and where the
        run goes (uniform).
        """
        variance = np.einsum("ij,ij->i", self.seen, np.linalg.solve(gathered, self.seen.T).T).clip(0.0)
        places = np.concatenate([self.places, self.course.outputs()])
        for way in self.open:
            variance += np.maximum(way * self.run - np.max(way * places), 0.0) ** 2 / 3.0
        return np.sqrt(variance)


def add_parts_for_use(
    fit: Fit,
    data: IOData,
    u: np.ndarray,
    course: Course,
    parts: Sequence[tuple[str, Part]],
    noise: float,
    clock: Clock,
) -> tuple[Use, list[tuple[str, int, int]]]:
    """The experiment for the input u (N,) of use, added to the course; with the name and samples of each of its parts.

    `parts` add to the course; pieces of u itself are among those that are tried. It ends where the deviation over u is
    small beside `noise` [y], where no part is worth its time, after `MOST_TIME`, or when the `clock` is late. Raises
    InputError where no part is added.
    """
    band = UseBand(fit, data, u, course)
    candidates = [*parts, *(("use", piece) for piece in _pieces(u, course))]
    now, quantity = band.deviation(band.gathered), display_quantity("deviation", data.y_unit or "")
    steps, added = [(0.0, _mean(now))], list[tuple[str, int, int]]()
    hopes = [np.inf] * len(candidates)  # what each was worth when it was last tried
    while steps[-1][1] > _ENOUGH * noise:
        best, worth, length = -1, -np.inf, 0.0
        for k in sorted(range(len(candidates)), key=lambda k: -hopes[k]):
            # A part is worth less the more is known (Minoux, Optimization Techniques 1978).
            if hopes[k] <= worth or clock.late:
                break
            hopes[k], seconds = _gain(band, candidates[k][1], steps[-1][1])
            if hopes[k] > worth:
                best, worth, length = k, hopes[k], seconds
        if worth <= _WORTH / 60.0 or steps[-1][0] + length > min(MOST_TIME, _MOST_SAMPLES * course.Ts):
            break
        first = course.N
        candidates[best][1]()
        band.gathered = band.gathers(first)
        added.append((candidates[best][0], first, course.N))
        steps.append((course.N * course.Ts, _mean(band.deviation(band.gathered))))
    if not added:
        off, enough = (number(value * quantity.factor, 2) for value in (steps[0][1], noise))
        known = f"little beside a reading, which is off by {enough}: the first record tells what this input needs"
        more = f"and no experiment of {MOST_TIME:.0f} s lowers it: allow larger --volts"
        if clock.late:
            more = "and no experiment was found in the time; allow more --seconds"
        raise InputError(
            f"over the input of use the model is expected to be off by {off} {quantity.unit}, "
            f"{known if steps[0][1] <= _ENOUGH * noise else more}"
        )
    return Use(u, fit.Ts, now, band.deviation(band.gathered), tuple(steps)), added


def _gain(band: UseBand, run: Part, deviation: float) -> tuple[float, float]:
    """By how much of itself a part lowers the mean variance in a second, and its seconds; 0 where it cannot be."""
    course, before, first = band.course, len(band.course.pieces), band.course.N
    try:
        run()
        seconds = (course.N - first) * course.Ts
        if seconds == 0.0 or _leaves(course, first):
            return 0.0, seconds
        variance = _mean(band.deviation(band.gathers(first))) ** 2
        return (1.0 - variance / deviation**2) / seconds, seconds
    except InputError:
        return 0.0, 0.0
    finally:
        del course.pieces[before:]


def _from_known_place(chain: Chain, J: np.ndarray) -> np.ndarray:
    """The Jacobian (N, P) of a run whose first output is known: the motor's place follows the other parameters."""
    place = J[:, chain.names.index(f"{motor_of(chain).role}.x0")]
    if place[0] != 0.0:
        J = J - np.outer(place, J[0] / place[0])
    return np.where(chain.initial, 0.0, J)


def _leaves(course: Course, first: int) -> bool:
    """Whether the course from this sample on goes beyond what was seen, where it may meet no end."""
    positions = course.positions()[first:]
    ways = [way for way in (-1, 1) if not course.may_meet[way]]
    return any(bool(np.any(way * (positions - course.target_position(way, SHORT_OF)) > 0.0)) for way in ways)


def _pieces(u: np.ndarray, course: Course) -> Iterator[Part]:
    """Pieces of the input of use within the largest inputs of the course."""
    played = np.clip(u, -course.tops[-1], course.tops[1])
    length = min(round(_PIECE / course.Ts), len(played))
    for first in np.unique(np.linspace(0, len(played) - length, _PIECES).astype(int)):
        yield partial(course.pieces.append, played[first : first + length])


def _mean(deviation: np.ndarray) -> float:
    return float(np.sqrt(np.mean(deviation**2)))

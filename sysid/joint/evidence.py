"""What a record bears out of a fitted joint's values: ends that were met, starts from rest, crossings of the backlash.

A fit has a number for every parameter, and a small interval where the model could not be otherwise. Whether the record
shows what the number stands for is a question to the record.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from sysid.base.quantities import display_quantity, number
from sysid.blocks import CoastingPlay, Play, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.breakaway import Breakaway, RestStart, breakaway, starts_from_rest
from sysid.joint.physics import breakaway_over_place, ends_of, travel_of, way_up
from sysid.joint.sampling import rate_needed, response_samples
from sysid.joint.spread import END_REACH, Spread, spread_of
from sysid.joint.stops import StopTest, noise_level, reading_noise, stop_test
from sysid.model.chain import Chain

STARTS = 2  # from rest in one direction, under a slowly rising voltage
CROSSINGS = 6  # of the backlash, both ways together
_BREAKAWAY_PRECISION = 0.125  # of the friction at rest: a wider standard uncertainty does not determine a break-away
_BACKLASH_PRECISION = 0.15  # of the backlash: a wider standard uncertainty of the fit does not determine it
_SIDE = 0.4  # of the backlash from its middle: the link lies against this side
_AT_TURN = 2.0  # backlashes from where the drive turned, of which it crosses one: beyond, its weight moved the link
_TIME_PRECISION = 0.5  # of lag and delay together: a wider standard deviation of one does not tell it from the other
_LARGEST_CORRELATION = -0.9  # a correlation of lag and delay below it leaves only their sum
PULSES = "qpal design --for breakaway FILE"


@dataclass(frozen=True)
class ValueEvidence:
    """Whether the record determines a value, one plain sentence why (not), and what was counted."""

    determined: bool
    why: str = ""
    counts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Evidence:
    """By name of a value, what the record shows of it; the tests of both ends and the starts from rest behind it.

    A value without an entry needs nothing but information. `breakaway`: what the starts add to the model's, by name.
    """

    values: Mapping[str, ValueEvidence]
    stops: Mapping[str, StopTest]
    starts: tuple[RestStart, ...]
    noise: float
    breakaway: Mapping[str, Breakaway]

    def determined(self, name: str) -> bool:
        """Whether the record determines the value `name`, as far as it takes more than information."""
        return self.values[name].determined if name in self.values else True

    def why(self, name: str) -> str:
        """The sentence of the value `name`; '' if there is none."""
        return self.values[name].why if name in self.values else ""


def evidence(fit: Fit, data: IOData, spread: Spread | None = None) -> Evidence:
    """What the estimation record `data` shows of the values of an actuated joint `fit`.

    end_low, end_high: see `sysid.joint.stops.stop_test`. breakaway_up, breakaway_down: at least `STARTS` starts
    from rest that a slowly rising voltage brackets (see `sysid.joint.breakaway`), and a standard uncertainty of 12 %
    of the friction at most. backlash: at least `CROSSINGS` of the model's link from side to side where the drive turns
    between the ends, and a standard uncertainty of 15 % at most in the fit. time_constant and delay: neither is told
    from their sum if Ts is longer than it, or if their correlation in the information matrix, their uncertainty or a
    limit says so. `spread` spares its
    computation.
    """
    chain, theta = fit.model, fit.theta
    spread = spread_of(fit, data, 0.95) if spread is None else spread
    noise, links, stops = reading_noise(data), _link_crossings(chain, theta, data), stop_tests(fit, data)
    values = {name: _stop_evidence(test, data.y_unit or "y", name) for name, test in stops.items()}
    readable = chain.block("sensor") is None and not isinstance(motor_of(chain), ServoMotor)
    starts = tuple(starts_from_rest(data, noise, _response_step(fit))) if readable else ()
    breakaways = {}
    for name, way in (("breakaway_up", 1), ("breakaway_down", -1)):
        breakaways[name] = breakaway(fit, data, starts, way * way_up(chain, theta), spread)
        values[name] = _start_evidence(breakaways[name].count, breakaways[name].share, "up" if way > 0 else "down")
    if links is not None:
        values["backlash"] = _crossing_evidence(fit, *links, _play_uncertainty(fit, spread))
    if motor_of(chain).delayed:
        values["time_constant"] = values["delay"] = _time_evidence(fit, spread)
    return Evidence(values, stops, starts, noise, breakaways)


def stop_tests(fit: Fit, data: IOData) -> dict[str, StopTest]:
    """`stop_test` of the fit's end_low and end_high on its record; empty for a joint without stops and travel.

    Where a map of the sensor follows, the place of the link is the model's, because the record does not show it. What
    drives a servo is its error. An end that the fit has out of reach was not met.
    """
    chain, theta = fit.model, fit.theta
    places = _places(chain, theta, data)
    drives, noise = _drives(chain, theta, data, places), float(np.median([noise_level(y) for y in places]))
    every = _response_step(fit)
    range_seen = max(float(y.max()) for y in places) - min(float(y.min()) for y in places)
    slack, tests = min(_play_width(chain, theta), END_REACH * range_seen), {}
    volts = None if isinstance(motor_of(chain), ServoMotor) else breakaway_over_place(chain, theta)
    for name, way, end in zip(("end_low", "end_high"), (-1.0, 1.0), ends_of(chain, theta), strict=True):
        if np.isfinite(end):
            known = np.nan if volts is None else way * way_up(chain, theta) * volts(end, int(way))
            known = np.inf if np.isnan(known) else known
            tests[name] = stop_test(drives, places, data.Ts, end, noise, way, slack, known, every)
        elif travel_of(chain) is not None:
            farthest = way * max(float(np.max(way * y)) for y in places)
            tests[name] = StopTest(False, "no stop explains the record there", (), farthest, np.inf)
    return tests


def _response_step(fit: Fit) -> int:
    """Samples in which lag and delay pass, at least 1: what a record shows of rests does not change faster."""
    return max(1, round(response_samples(fit.model, fit.theta)))


def _drives(chain: Chain, theta: np.ndarray, data: IOData, places: list[np.ndarray]) -> list[np.ndarray]:
    """What drives the motor in each experiment: the input, or the error of a servo."""
    inputs = [record.u[:, 0] for record in data.experiments]
    motor = motor_of(chain)
    if not isinstance(motor, ServoMotor):
        return inputs
    k = chain.blocks.index(motor)
    return [chain.through(theta, u, 0, k) - place for u, place in zip(inputs, places, strict=True)]


def _places(chain: Chain, theta: np.ndarray, data: IOData) -> list[np.ndarray]:
    """Place of the link in each experiment: the record, or where a sensor's map follows, what the model says."""
    sensor = chain.block("sensor")
    if sensor is None:
        return [record.y[:, 0] for record in data.experiments]
    k = chain.blocks.index(sensor)
    return [chain.through(row, record.u[:, 0], 0, k) for row, record in _experiment_runs(chain, theta, data)]


def _experiment_runs(chain: Chain, theta: np.ndarray, data: IOData) -> list[tuple[np.ndarray, IOData]]:
    """theta with the initial state of each experiment, and the experiment."""
    return [
        (theta if k == 0 else estimate_initial(chain, theta, record), record)
        for k, record in enumerate(data.experiments)
    ]


def _play_width(chain: Chain, theta: np.ndarray) -> float:
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)
    return 0.0 if play is None else float(chain.part(theta, play)[0])


def _link_crossings(chain: Chain, theta: np.ndarray, data: IOData) -> tuple[int, int] | None:
    """How often the model's link crosses its backlash upward and downward right where the drive turns between the ends;
    None without a backlash.

    Elsewhere a backlash is not alone: what the model lacks of load, friction and linkage differs between two passes of
    one place, an end has some give and a switch before it, and any of these looks like the link on its other side.
    """
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)
    if play is None:
        return None
    k, width, counts = chain.blocks.index(play), _play_width(chain, theta), [0, 0]
    for row, record in _experiment_runs(chain, theta, data):
        x = chain.through(row, record.u[:, 0], 0, k)
        share = (play.output(chain.part(row, play), x) - x) / max(width, 1e-300)
        against = np.flatnonzero(np.abs(share) > _SIDE)
        crossed = np.flatnonzero(np.diff(np.sign(share[against])))
        first, reach = 0, END_REACH * float(np.ptp(x))
        for last, arrival in zip(against[crossed], against[crossed + 1], strict=True):
            way = float(np.sign(share[last]))  # of a drive that leaves the side on which the link lay
            place = way * x
            turn = float(place[first:arrival].min())
            at_turn = turn < place[arrival] and place[arrival - 1] - turn <= _AT_TURN * width
            at_end = min(abs(way * turn - end) for end in ends_of(chain, theta)) <= reach
            counts[int(way > 0.0)] += bool(at_turn and not at_end)
            first = int(last)
    return counts[0], counts[1]


def _stop_evidence(test: StopTest, unit: str, name: str) -> ValueEvidence:
    counts = {"rests": len(test.visits), "arrivals": test.arrivals, "farthest": test.farthest}
    if test.met:
        return ValueEvidence(True, f"rests of the joint against it: {len(test.visits)}", counts)
    quantity = display_quantity(name, unit)
    place = f"{number(test.farthest * quantity.factor, 4)} {quantity.unit}".rstrip()
    return ValueEvidence(False, f"not reached: beyond {place} ({test.why})", counts)


def _start_evidence(count: int, share: float, way: str) -> ValueEvidence:
    counts = {"slow_starts": count, "uncertainty": share}
    sentence = f"{count or 'no'} {way}ward start{'' if count == 1 else 's'} from rest under a slowly rising voltage"
    if count < STARTS:
        return ValueEvidence(
            False, f"{sentence}, but {STARTS} that agree are needed: record rising pulses from rest ({PULSES})", counts
        )
    if not np.isfinite(share):
        return ValueEvidence(
            False, f"{sentence} contradict the model: record rising pulses from rest ({PULSES})", counts
        )
    if share > _BREAKAWAY_PRECISION:
        leave = f"{sentence} leave it uncertain by {spread_in_words(share)}"
        return ValueEvidence(False, f"{leave}: record rising pulses from rest ({PULSES})", counts)
    return ValueEvidence(True, sentence, counts)


def spread_in_words(share: float) -> str:
    """A spread as a share of the value; many times the value is no more than that."""
    return f"±{100.0 * share:.0f} %" if share < 10.0 else "more than itself"


def _crossing_evidence(fit: Fit, up: int, down: int, std: float) -> ValueEvidence:
    counts = {"crossings_up": up, "crossings_down": down, "uncertainty": std}
    if up + down < CROSSINGS:
        reason = (
            f"crossings by the link where the drive turns between the ends: {up + down}, but {CROSSINGS} are needed"
        )
        advice = "reverse slowly where its weight changes sides (qpal design --for backlash FILE)"
        return ValueEvidence(False, f"{reason}: {advice}", counts)
    if not std <= _BACKLASH_PRECISION:
        reason = (
            f"uncertain by {spread_in_words(std)}, as what the link does on its way across looks like lag and friction"
        )
        return ValueEvidence(
            False, f"{reason}; {_record_advice(fit, 'and reverse slowly')} (qpal design --for backlash FILE)", counts
        )
    return ValueEvidence(True, f"the link crosses it {up + down} times where the drive turns", counts)


def _play_uncertainty(fit: Fit, spread: Spread) -> float:
    """Standard uncertainty of the backlash in the fit, as a share of it."""
    std = spread.std(lambda theta: _play_width(fit.model, theta))
    return std / max(_play_width(fit.model, fit.theta), 1e-300) if np.isfinite(std) else np.inf


def _time_evidence(fit: Fit, spread: Spread) -> ValueEvidence:
    """Whether lag and delay are told apart: by the sampling time, their limits, correlation and uncertainty."""
    chain, motor, Ts = fit.model, motor_of(fit.model), fit.Ts
    indices = [chain.names.index(f"{motor.role}.{part}") for part in ("lag", "delay")]
    std = [spread.std(partial(_theta_entry, i)) for i in indices]
    cov = spread.noise.covariance_of(np.eye(len(chain.names))[indices])
    size = float(np.sqrt(cov[0, 0] * cov[1, 1]))
    r, sum_of_both = float(cov[0, 1]) / size if size > 0.0 else 0.0, float(fit.theta[indices].sum())
    counts = {
        "correlation": r,
        "samples": sum_of_both,
        "uncertainty": max(std) / sum_of_both if sum_of_both > 0.0 else np.inf,
    }
    names = ("time constant", "delay")
    limited_names = [
        name
        for i, name in zip(indices, names, strict=True)
        if not chain.limits[0][i] < fit.theta[i] < chain.limits[1][i]
    ]
    if sum_of_both < 1.0:
        reason = f"the sampling time of {Ts:g} s is longer than time constant and delay together"
    elif limited_names:
        reason = (
            f"the {limited_names[0]} of the fit is at the limit of its range, so only its sum with the other is known"
        )
    elif not np.all(np.isfinite(std)):
        reason = "the record has no information on the share of time constant and delay in their sum"
    elif r < _LARGEST_CORRELATION:
        reason = f"an error of the time constant looks like one of the delay (correlation {r:.2f})"
    elif max(std) > _TIME_PRECISION * sum_of_both / 2:
        k = int(np.argmax(std))
        share = f"{std[k] * Ts:.2g} s, of {sum_of_both * Ts:.2g} s together"
        reason = f"the standard uncertainty of the {names[k]} alone is {share}"
    else:
        return ValueEvidence(True, f"correlation {r:.2f}", counts)
    return ValueEvidence(False, f"{reason}; {_record_advice(fit, 'to tell them apart')}", counts)


def _theta_entry(i: int, theta: np.ndarray) -> float:
    return float(theta[i])


def _record_advice(fit: Fit, purpose: str) -> str:
    """What to do for a quicker motion than the record resolves."""
    times = rate_needed(fit)
    return f"sample {times} times faster {purpose}" if times > 1 else f"record longer {purpose}"

"""A voltage course over an identified joint: pieces of constant input, with what the joint does in between."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks.motor import LOADS
from sysid.data.record import IOData
from sysid.estimation.joint_parts import lift_theta, motor_of, sub
from sysid.estimation.result import Fit
from sysid.joint.evidence import stop_tests
from sysid.joint.physics import travel_of
from sysid.joint.sampling import chain_at_rate, response_samples, theta_at_rate
from sysid.joint.stops import reading_noise
from sysid.model.chain import Chain

LONGEST = 2**16  # samples of one way from end to end
ARRIVED = 0.98  # of the way between the ends
# Of the friction in motion: a joint at rest starts at some pulse of a rising series. Two of three series end early,
# because a joint that has started goes on with every further pulse.
FIRST, STEP = 0.85, 0.06
TOPS = (1.4, 1.6, 2.0)
CAREFUL = 0.95  # of the largest speed that is allowed: the real joint may be a little faster than the fit
MOVE = 0.03  # of the way between the ends: a slow reversal's
_SHOWN = 2.0  # of lag and delay, after which the joint shows whether a pulse started it
ALONG = (0.02, 0.25, 0.5, 0.75, 0.98)  # places on the way, whose loads differ
_STARTS = 1e-6  # of the way: motion that counts as started
_HALVINGS = 30
RESTS = 0.5  # [s] between two movements, at least
LONG = 1.2  # of the way: longer runs rest at the end, shorter ones turn on the way or just after they arrive
SHORT_OF = 0.9  # of the way seen: where the joint may meet no end
_SEEN = 6.0  # standard deviations of a reading that a pulse moves a joint by
_RESTED = 8  # times lag and delay: a rest that shows an end
_STICK = 0.7  # of the friction in motion: what a fit says of friction at rest beyond it is not believed
_FAR = 3.0  # of the way: outside it no prediction is meant
_BEYOND_RECORD = 0.3  # of the way seen: how far outside a stop may be that the joint may run into


@dataclass
class Course:
    """Held levels one after the other. Ways are +1 and -1, the sign of the input's effect on the motor's position.

    `tops` are the largest inputs each way (positive numbers), `ends` the motor's positions between which the course is
    planned: a stop each way if the joint may run into it (`may_meet`), else the outermost position that it was seen at.
    `falls`: the output falls as that position rises. `noise` [y]: the standard deviation of a reading.
    """

    chain: Chain
    theta: np.ndarray
    Ts: float
    ends: tuple[float, float]
    may_meet: dict[int, bool]
    falls: bool = False
    noise: float = 0.0
    tops: dict[int, float] = field(default_factory=dict)
    pieces: list[np.ndarray] = field(default_factory=list)
    _known_share: tuple[bytes, float] = field(default=(b"", 0.0), repr=False)

    @classmethod
    def of(
        cls, fit: Fit, data: IOData, top: float, strike: float | None, Ts: float, to_stops: bool = False
    ) -> "Course":
        """An empty course on the joint of a fit, with inputs up to `top`, speeds up to `strike` [y/s], samples of `Ts`.

        `to_stops`: the joint may run into a stop each way, also where `data` shows none. Raises InputError if the joint
        does not move under these limits.
        """
        chain, motor = chain_at_rate(fit.model, fit.Ts / Ts), motor_of(fit.model)
        positions = chain.signals(fit.theta, data.u)[chain.blocks.index(motor) + 1]
        is_met_by_way = stops_met(fit, data)
        ends = tuple(planned_end(fit, way, positions, is_met_by_way[way], to_stops) for way in (-1, 1))
        theta = theta_at_rate(fit.model, fit.theta, fit.Ts / Ts)
        theta[chain.names.index(f"{motor.role}.v0")] = 0.0
        course = cls(
            chain,
            theta,
            Ts,
            (ends[0], ends[1]),
            {way: is_met or to_stops for way, is_met in is_met_by_way.items()},
            output_falls(fit),
            reading_noise(data),
        )
        for way in (-1, 1):
            course.tops[way] = course._largest_input(way, top, strike)
            least = way * course.starting_input(way, ALONG)
            if course.tops[way] <= least:
                limit = f"{top:.4g}" if strike is None else f"{course.tops[way]:.4g} (for a speed up to {strike:.4g})"
                raise InputError(
                    f"the joint starts at {way * least:.4g} and the input may not exceed {limit}; allow larger "
                    "inputs or speeds"
                )
        return course

    @property
    def N(self) -> int:
        """Samples so far."""
        return sum(map(len, self.pieces))

    def output_way(self, way: int) -> int:
        """The way of the output, 1 or -1, for one of the motor."""
        return -way if self.falls else way

    def inputs(self) -> np.ndarray:
        """u (N,)."""
        return np.concatenate(self.pieces) if self.pieces else np.zeros(0)

    def outputs(self) -> np.ndarray:
        """The predicted y (N,)."""
        return self._simulate(self.theta, self.inputs())

    def joint(self) -> tuple[Chain, np.ndarray]:
        """The joint that predicts y: that of the fit, with a stop far out where the prediction runs away."""
        (low, high), places = self.ends, self.positions()
        far = _FAR * (high - low)
        inside = places.min() > low - far and places.max() < high + far
        return (self.chain, self.theta) if inside else (self._stopped, self._with_stops(self.theta))

    def sensitivity(self) -> np.ndarray:
        """Derivatives (N, P) of the predicted y by the parameters of the chain."""
        with np.errstate(all="ignore"):
            J = self._stopped.tangent(self._with_stops(self.theta), self.inputs())[1]
        return np.asarray(J[:, [self._stopped.names.index(name) for name in self.chain.names]])

    def positions(self) -> np.ndarray:
        """The predicted position of the motor (N,)."""
        return self._positions(self.theta, self.inputs())

    def add_level(self, level: float, samples: int) -> None:
        """Holds an input [unit of u] for so many samples."""
        if samples > 0:
            self.pieces.append(np.full(int(samples), float(level)))

    def add_rest(self) -> None:
        """Holds the input under which the joint stands still, until it does."""
        self.add_level(self.resting_input, max(round(RESTS / self.Ts), 2 * self.observation_samples))

    def level(self, way: int, share: float) -> float:
        """Size of an input `share` of the way from the one that moves the joint everywhere to the largest."""
        least = self._starting_levels[way]
        return least + share * (self.tops[way] - least)

    def add_stroke(self, way: int, share: float, part: float) -> None:
        """Experiment on ends and speed: `part` of the way from end to end at `level(way, share)`.

        With a rest at the end from `LONG` on; where the joint may meet no end, no farther than a place short of it.
        """
        level = way * self.level(way, share)
        if not self.may_meet[way]:
            self.add_level(level, round(min(part, 1.0) * self._samples_to(way, level, SHORT_OF, self._current_share())))
            return
        rests = round(_RESTED * response_samples(self.chain, self.theta)) if part >= LONG else 0
        self.add_level(level, max(2, round(part * self._samples_to(way, level, ARRIVED))) + rests)

    def add_approach(self, place: float, way: int = 1) -> None:
        """Brings the joint to `place`, a share of the way between the ends, before the slow part of an experiment.

        In the direction `way` from the end where such runs begin, so that a backlash is closed; straight where the
        joint may meet no end, and from the other end if only that.
        """
        if not self.may_meet[-way]:
            way = -way
        if not self.may_meet[-way]:
            share = self._current_share()
            way = 1 if share < place else -1
            level = way * self.level(way, 0.5)
            self.add_level(level, self._samples_to(way, level, place if way > 0 else 1.0 - place, share))
            return
        # Surely at the end: a fifth of the whole way more than from where it should be now.
        level, back = way * self.level(way, 0.5), -way * self.level(-way, 1.0)
        left = (self._current_share() if way > 0 else 1.0 - self._current_share()) if self.pieces else 1.0
        self.add_level(
            back, round((1.2 * left + 0.2) * self._samples_to(-way, back, ARRIVED)) + self.observation_samples
        )
        self.add_rest()
        self.add_level(level, self._samples_to(way, level, place if way > 0 else 1.0 - place))

    def rising_levels(self, way: int, top: float) -> np.ndarray:
        """Experiment on break-away: pulses from below the input that keeps the joint moving to `top` of the friction.

        Where the joint may meet no end, without those that are predicted to take it out of the range seen.
        """
        middle, half = self.band
        levels = middle + way * half * np.arange(FIRST, top + 0.5 * STEP, STEP)
        levels = levels[(way * levels <= self.tops[way]) & (way * (levels - self.resting_input) > 0.0)]
        if self.may_meet[way] or not len(levels):
            return levels
        pulse_shape = np.concatenate([np.ones(self.pulse_samples), np.zeros(self.observation_samples)])
        pulses = np.concatenate([np.where(pulse_shape, v, self.resting_input) for v in levels])
        positions = self._positions(self._theta_at_rest(self._current_share()), pulses)
        out = np.flatnonzero(way * (positions - self.target_position(way, SHORT_OF)) > 0.0)
        return levels[: out[0] // len(pulse_shape)] if len(out) else levels

    @cached_property
    def pulse_samples(self) -> int:
        """Samples of a pulse: a joint that three pulses above its friction is seen to move."""
        n, (middle, half) = 4 * self.observation_samples + 20, self.band
        moves = []
        for way in (1, -1):
            level = middle + way * half * (1.0 + 3.0 * STEP)
            y = self._simulate(self._theta_at_rest(0.5), np.full(n, level))
            moves.append(abs(float(y[-1] - y[n // 2])) / (n - 1 - n // 2))
        needed = np.ceil(_SEEN * self.noise / max(min(moves), 1e-300))
        return int(np.clip(needed, 1, 15 * self.observation_samples)) + self.observation_samples

    @property
    def observation_samples(self) -> int:
        """Samples after which a joint shows whether it started."""
        return max(2, int(np.ceil(_SHOWN * response_samples(self.chain, self.theta))))

    def add_reversal(self, way: int, share: float) -> None:
        """Experiment on backlash: `level(way, share)` that moves the joint from rest by `MOVE`, and a rest."""
        level, stroke = way * self.level(way, share), self.ends[1] - self.ends[0]
        rest = np.full(self.observation_samples, self.resting_input)
        start = self._theta_at_rest(self._current_share())
        longest = self._samples_to(way, level, 0.5 + MOVE, 0.5)
        samples = longest
        for n in range(2, longest):
            place = self._positions(start, np.concatenate([np.full(n, level), rest]))
            if way * (place[-1] - place[0]) >= MOVE * stroke:
                samples = n
                break
        self.add_level(level, samples)
        self.add_level(self.resting_input, self.observation_samples)

    @cached_property
    def resting_input(self) -> float:
        """Input under which the joint stands still: 0, or where its load moves it the middle of the friction's band."""
        return 0.0 if self.starting_input(-1) < 0.0 < self.starting_input(1) else self.band[0]

    @property
    def band(self) -> tuple[float, float]:
        """Middle of the inputs that keep the joint moving up and down, which is the load, and half of what is between
        them, which is the friction."""
        up_start, down_start = self.starting_input(1), self.starting_input(-1)
        return 0.5 * (up_start + down_start), 0.5 * (up_start - down_start)

    def starting_input(self, way: int, places: tuple[float, ...] = (0.5,), bare: bool = True) -> float:
        """Input that moves the joint at all `places` (shares of the way), by bisection.

        `bare`: without more friction at rest than in motion, which a fit only guesses before the joint has started
        slowly.
        """
        key = (way, places, bare)
        if key not in self._starting_inputs:
            low, high = -self.largest, self.largest
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                if all(self._starts_moving(way, way * middle, place, bare) for place in places):
                    high = middle
                else:
                    low = middle
            self._starting_inputs[key] = way * high
        return self._starting_inputs[key]

    @cached_property
    def _starting_inputs(self) -> dict[tuple[int, tuple[float, ...], bool], float]:
        return {}

    @cached_property
    def _starting_levels(self) -> dict[int, float]:
        """Input each way (positive) that starts the joint everywhere, as far as the fit is believed."""
        least, believed_excess = {}, _STICK * self.band[1]
        for way in (-1, 1):
            bare_start, stuck_start = (way * self.starting_input(way, ALONG, free) for free in (True, False))
            least[way] = min(stuck_start, bare_start + believed_excess, 0.5 * (bare_start + self.tops[way]))
        return least

    @cached_property
    def largest(self) -> float:
        """Input that surely starts any joint of this kind."""
        motor = motor_of(self.chain)
        part = self.chain.part(self.theta, motor)
        volts = sum(abs(motor.value(part, n)) for n in ("rise", "fall", "stick", "stick_down", *LOADS))
        return 10.0 * max(volts * (1.0 + motor.value(part, "loss")), 1e-9) + 1.0

    def _starts_moving(self, way: int, level: float, place: float, bare: bool) -> bool:
        rest = self._positions(self._theta_at_rest(place, bare), np.full(2 * self.observation_samples + 20, level))
        return bool(way * (rest[-1] - rest[0]) > _STARTS * (self.ends[1] - self.ends[0]))

    def _largest_input(self, way: int, top: float, strike: float | None) -> float:
        """The largest input that keeps the speed below `strike`."""
        if strike is None or self._largest_speed(way, way * top) <= CAREFUL * strike:
            return top
        low, high = 0.0, top
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._largest_speed(way, way * middle) <= CAREFUL * strike else (low, middle)
        return low

    def _largest_speed(self, way: int, level: float) -> float:
        """The largest speed [y/s] on the way from the far end, where the joint has come to rest."""
        settling_samples = 2 * self.observation_samples + 20
        u = np.concatenate(
            [np.full(settling_samples, self.resting_input), np.full(self._crossing_samples(level), level)]
        )
        y = self._simulate(self._theta_at_rest(0.0 if way > 0 else 1.0), u)[settling_samples:]
        return float(np.abs(np.diff(y)).max()) / self.Ts

    def _crossing_samples(self, level: float) -> int:
        """Samples in which a joint crosses the way at the motor's speed, three times over."""
        motor = motor_of(self.chain)
        gain = motor.value(self.chain.part(self.theta, motor), "gain")
        speed = gain * max(abs(level), 1e-9)
        return int(np.clip(3.0 * (self.ends[1] - self.ends[0]) / max(speed, 1e-12) + 50, 50, LONGEST))

    def _samples_to(self, way: int, level: float, place: float, share: float | None = None) -> int:
        """Samples to `place`, a share of the way in the direction of motion; from the far end, or from `share`."""
        start = self._theta_at_rest((0.0 if way > 0 else 1.0) if share is None else share)
        n, target = self._crossing_samples(level), self.target_position(way, place)
        while n <= LONGEST:
            arrivals = np.flatnonzero(way * (self._positions(start, np.full(n, level)) - target) >= 0.0)
            if len(arrivals):
                return int(arrivals[0])
            n *= 2
        raise InputError(
            f"the joint does not cross its way at an input of {level:.4g}; allow larger inputs or speeds, or record "
            "one way from end stop to end stop first"
        )

    def target_position(self, way: int, place: float) -> float:
        """The motor's position at `place`, a share of the way in the direction of motion."""
        low, high = self.ends
        return (low if way > 0 else high) + way * place * (high - low)

    def _current_share(self) -> float:
        """Where the motor is now, as a share of the way."""
        inputs = np.append(self.inputs(), self.resting_input)
        if self._known_share[0] != inputs.tobytes():
            position = self._positions(self.theta, inputs)[-1]
            share = float(np.clip((position - self.ends[0]) / (self.ends[1] - self.ends[0]), 0.0, 1.0))
            self._known_share = inputs.tobytes(), share
        return self._known_share[1]

    def _theta_at_rest(self, place: float, bare: bool = True) -> np.ndarray:
        """theta with the motor at rest at a share of the way, and no more friction there than in motion if `bare`."""
        theta, role = np.array(self.theta), motor_of(self.chain).role
        theta[self.chain.names.index(f"{role}.x0")] = self.ends[0] + place * (self.ends[1] - self.ends[0])
        for name in (f"{role}.stick", f"{role}.stick_down"):
            if bare and name in self.chain.names:
                theta[self.chain.names.index(name)] = 0.0
        return theta

    def _positions(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The motor's position (N,)."""
        k = self.chain.blocks.index(motor_of(self.chain))
        return np.asarray(self._stopped.signals(self._with_stops(theta), u)[k + 1]).ravel()

    def _simulate(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(self._stopped.simulate(self._with_stops(theta), u)).ravel()

    @cached_property
    def _stopped(self) -> Chain:
        """The joint with a stop each way, far out where the fit has none: the load of a fit may make it run away."""
        motor = motor_of(self.chain)
        blocks = tuple(replace(motor, stops=True) if block is motor else block for block in self.chain.blocks)
        return sub(self.chain, blocks)

    def _with_stops(self, theta: np.ndarray) -> np.ndarray:
        role, (low, high) = motor_of(self.chain).role, self.ends
        far = {f"{role}.lower": low - _FAR * (high - low), f"{role}.upper": high + _FAR * (high - low)}
        own = dict(zip(self.chain.names, theta, strict=True))
        return lift_theta(self.chain, theta, self._stopped, {name: own.get(name, end) for name, end in far.items()})


def output_falls(fit: Fit) -> bool:
    """Whether the output falls as the motor's position rises."""
    travel = travel_of(fit.model)
    if travel is None:
        return False
    low, high = fit.model.part(fit.theta, travel)[:2]
    return bool(high < low)


def stops_met(fit: Fit, data: IOData) -> dict[int, bool]:
    """Whether the record shows a stop, by the motor's way."""
    tests, falls = stop_tests(fit, data), output_falls(fit)
    lower, upper = (name in tests and tests[name].met for name in ("end_low", "end_high"))
    return {-1: upper, 1: lower} if falls else {-1: lower, 1: upper}


def planned_end(fit: Fit, way: int, positions: np.ndarray, met: bool, to_stops: bool) -> float:
    """Position of the motor up to which the course is planned."""
    motor = motor_of(fit.model)
    name = "upper" if way > 0 else "lower"
    stop = motor.value(fit.model.part(fit.theta, motor), name) if name in motor.ends else way * np.inf
    farthest, range_seen = way * float((way * positions).max()), float(np.ptp(positions))
    if met or (to_stops and 0.0 <= way * (stop - farthest) <= _BEYOND_RECORD * range_seen):
        return float(stop)
    return farthest + way * (_BEYOND_RECORD * range_seen if to_stops else 0.0)

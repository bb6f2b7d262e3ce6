"""A voltage course over an identified joint: pieces of constant input, with what the joint does in between."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.rate import at_rate, response
from sysid.model.chain import Chain

LONGEST = 2**16  # samples of one way from end to end
ARRIVED = 0.98  # of the way between the ends
SHARES = np.arange(0.7, 2.0, 0.04)  # of the input against friction in motion: the levels of the stairs
CAREFUL = 0.95  # of the largest speed that is allowed: the real joint may be a little faster than the fit
MOVE = 0.03  # of the way between the ends: a slow reversal's
_SHOWN = 2.0  # of lag and delay, after which the joint shows whether a stair started it
ALONG = (0.02, 0.25, 0.5, 0.75, 0.98)  # places on the way, whose loads differ
_STARTS = 1e-6  # of the way: motion that counts as started
_HALVINGS = 30


@dataclass
class Course:
    """Held levels one after the other. Ways are +1 and -1, the sign of the input's effect on the motor's position.

    `tops` are the largest inputs each way (positive numbers), `ends` the motor's positions between which the course is
    planned: its stops, or, where it has none (`free`), the range that it was seen in.
    """

    chain: Chain
    theta: np.ndarray
    Ts: float
    ends: tuple[float, float]
    free: bool
    tops: dict[int, float] = field(default_factory=dict)
    pieces: list[np.ndarray] = field(default_factory=list)
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, fit: Fit, data: IOData, top: float, strike: float | None, Ts: float) -> "Course":
        """An empty course on the joint of a fit, with inputs up to `top`, speeds up to `strike` [y/s], samples of `Ts`.

        Raises InputError if the joint does not move under these limits.
        """
        chain, motor = fit.model, motor_of(fit.model)
        own = chain.part(fit.theta, motor)
        place = chain.signals(fit.theta, data.u)[chain.blocks.index(motor) + 1]
        bounded = motor.stops and all(np.isfinite(motor.value(own, name)) for name in ("lower", "upper"))
        ends = (motor.value(own, "lower"), motor.value(own, "upper")) if bounded else (place.min(), place.max())
        theta = at_rate(chain, fit.theta, fit.Ts / Ts)
        theta[chain.names.index(f"{motor.role}.v0")] = 0.0
        course = cls(chain, theta, Ts, (float(ends[0]), float(ends[1])), not bounded)
        for way in (-1, 1):
            course.tops[way] = course._top(way, top, strike)
            least = way * course.starts(way, ALONG)
            if course.tops[way] <= least:
                limit = f"{top:.4g}" if strike is None else f"{course.tops[way]:.4g} (for a speed up to {strike:.4g})"
                raise InputError(
                    f"the joint starts at {way * least:.4g} and the input may not exceed {limit}; allow larger "
                    "inputs or speeds"
                )
        if course.free:
            course.notes = ("the joint has no end stops in the first fit; the course stays in the range seen there",)
        return course

    @property
    def N(self) -> int:
        """Samples so far."""
        return sum(map(len, self.pieces))

    def inputs(self) -> np.ndarray:
        """u (N,)."""
        return np.concatenate(self.pieces) if self.pieces else np.zeros(0)

    def outputs(self) -> np.ndarray:
        """The predicted y (N,)."""
        return self._run(self.theta, self.inputs())

    def hold(self, level: float, samples: int) -> None:
        """Hold an input."""
        self.pieces.append(np.full(max(int(samples), 1), float(level)))

    def rest(self, seconds: float) -> None:
        """Hold the input under which the joint stands still."""
        self.hold(self.still, max(1, round(seconds / self.Ts)))

    def level(self, way: int, share: float) -> float:
        """Size of an input `share` of the way from the one that keeps the joint moving everywhere to the largest."""
        least = way * self.starts(way, ALONG)
        return least + share * (self.tops[way] - least)

    def crossing(self, way: int, share: float) -> int:
        """Samples from end to end at `level(way, share)`."""
        return self._until(way, way * self.level(way, share), ARRIVED)

    def go(self, place: float) -> None:
        """To `place`, a share of the way between the ends: from the lower end, or straight where there is none."""
        if not self.free:
            # Surely there: a fifth of the whole way more than from where it should be now.
            low, whole = -self.level(-1, 0.5), self.crossing(-1, 0.5)
            self.hold(low, round((1.2 * self._share() + 0.2) * whole) + self.step)
            self.rest(0.5)
            self.hold(self.level(1, 0.5), self._until(1, self.level(1, 0.5), place))
            return
        u, target = self.inputs(), self.ends[0] + place * (self.ends[1] - self.ends[0])
        way = 1 if self._place(self.theta, np.append(u, self.still))[-1] < target else -1
        level = way * self.level(way, 0.5)
        ahead = self._place(self.theta, np.append(u, np.full(self._samples(level), level)))[len(u) :]
        there = np.flatnonzero(way * (ahead - target) >= 0.0)
        self.hold(level, there[0] if len(there) else len(ahead))

    def stairs(self, way: int) -> np.ndarray:
        """Levels from below the voltage that starts the joint to above it."""
        levels = self.still + SHARES * (self.starts(way) - self.still)
        return levels[way * levels <= self.tops[way]]

    @property
    def step(self) -> int:
        """Samples that a stair is held for: the joint shows whether it started."""
        return max(2, int(np.ceil(_SHOWN * response(self.chain, self.theta))))

    def reversal(self, way: int, share: float) -> int:
        """Samples for `MOVE` of the way between the ends at `level(way, share)`."""
        level = way * self.level(way, share)
        return max(3, self._until(way, level, 0.5 + MOVE / 2) - self._until(way, level, 0.5 - MOVE / 2))

    @cached_property
    def still(self) -> float:
        """Input under which the joint stands still: 0, or where its load moves it the middle of the friction's band."""
        down, up = self.starts(-1), self.starts(1)
        return 0.0 if down < 0.0 < up else 0.5 * (down + up)

    def starts(self, way: int, places: tuple[float, ...] = (0.5,)) -> float:
        """Input that keeps the joint moving at all `places`, by bisection: friction in motion, without more at rest.

        What a fit says of friction at rest is a guess before the joint has started slowly. Places: shares of the way.
        """
        if (way, places) not in self._starts:
            low, high = -self.largest, self.largest
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                if all(self._moves(way, way * middle, place) for place in places):
                    high = middle
                else:
                    low = middle
            self._starts[way, places] = way * high
        return self._starts[way, places]

    @cached_property
    def _starts(self) -> dict[tuple[int, tuple[float, ...]], float]:
        return {}

    @cached_property
    def largest(self) -> float:
        """Input that surely starts any joint of this kind."""
        motor = motor_of(self.chain)
        own = self.chain.part(self.theta, motor)
        volts = sum(abs(motor.value(own, n)) for n in ("rise", "fall", "stick", "load0", "load1", "load2"))
        return 10.0 * max(volts * (1.0 + motor.value(own, "loss")), 1e-9) + 1.0

    def _moves(self, way: int, level: float, place: float) -> bool:
        theta, stick = self._at(place), f"{motor_of(self.chain).role}.stick"
        if stick in self.chain.names:
            theta[self.chain.names.index(stick)] = 0.0
        rest = self._place(theta, np.full(2 * self.step + 20, level))
        return bool(way * (rest[-1] - rest[0]) > _STARTS * (self.ends[1] - self.ends[0]))

    def _top(self, way: int, top: float, strike: float | None) -> float:
        """The largest input that keeps the speed below `strike`."""
        if strike is None or self._speed(way, way * top) <= CAREFUL * strike:
            return top
        low, high = 0.0, top
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._speed(way, way * middle) <= CAREFUL * strike else (low, middle)
        return low

    def _speed(self, way: int, level: float) -> float:
        """The largest speed [y/s] on the way from the far end."""
        y = self._run(self._at(0.0 if way > 0 else 1.0), np.full(self._samples(level), level))
        return float(np.abs(np.diff(y)).max()) / self.Ts

    def _samples(self, level: float) -> int:
        """Samples in which a joint crosses the way at the motor's speed, three times over."""
        motor = motor_of(self.chain)
        gain = motor.value(self.chain.part(self.theta, motor), "gain")
        speed = gain * max(abs(level), 1e-9)
        return int(np.clip(3.0 * (self.ends[1] - self.ends[0]) / max(speed, 1e-12) + 50, 50, LONGEST))

    def _until(self, way: int, level: float, place: float) -> int:
        """Samples from the far end to `place`, a share of the way in the direction of motion."""
        low, high = self.ends
        start = self._at(0.0 if way > 0 else 1.0)
        target = (low if way > 0 else high) + way * place * (high - low)
        n = self._samples(level)
        while n <= LONGEST:
            there = np.flatnonzero(way * (self._place(start, np.full(n, level)) - target) >= 0.0)
            if len(there):
                return int(there[0])
            n *= 2
        raise InputError(
            f"the joint does not cross its way at an input of {level:.4g}; allow larger inputs or speeds, or record "
            "one way from end to end first"
        )

    def _share(self) -> float:
        """Where the motor is now, as a share of the way."""
        at = self._place(self.theta, np.append(self.inputs(), self.still))[-1]
        return float(np.clip((at - self.ends[0]) / (self.ends[1] - self.ends[0]), 0.0, 1.0))

    def _at(self, place: float) -> np.ndarray:
        """theta with the motor at rest at a share of the way."""
        theta = np.array(self.theta)
        theta[self.chain.names.index(f"{motor_of(self.chain).role}.x0")] = self.ends[0] + place * (
            self.ends[1] - self.ends[0]
        )
        return theta

    def _place(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The motor's position (N,)."""
        k = self.chain.blocks.index(motor_of(self.chain))
        return np.asarray(self.chain.signals(theta, u)[k + 1]).ravel()

    def _run(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(self.chain.simulate(theta, u)).ravel()

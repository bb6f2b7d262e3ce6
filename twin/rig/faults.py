"""Faults put into runs of the real firmware: when each could be seen first, and when the drive was off.

One case is one run of three drawn joints with random levels, in simulated time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.rig import wire
from twin.rig.avr import STEP, Avr
from twin.rig.scripted import FULL, HIGH, HOLD, LOW, MOTION, PERIOD, STALL, SUPPLY, Legs, Run, random_levels

AFTER = 0.25  # [s] for which the drive has to stay off
ALLOWED = 0.05  # [s]
NOISE = 6  # [counts] by which readings of a joint that moves are uncertain
SETTLING = 0.02  # [s] that the firmware's smoothed reading takes to stand


class Watch:
    """Says from when on a fault can be seen; made at the moment of the fault, asked after every millisecond."""

    def __init__(self, run: Run, joint: int) -> None:
        self.run, self.joint, self.still, self.way = run, joint, 0.0, 0
        self.from_place = self.turned = 0.0
        self.shadow = self.shadow_speed = 0.0

    def at_once(self) -> bool:
        """From the moment on."""
        return True

    def last_byte(self) -> bool:
        """From the last byte on that reaches the board."""
        return self.run.avr.time >= self.run.last_byte

    def pulled(self) -> bool:
        """From the last byte on that came through."""
        return self.run.bytes_left == 0 and self.last_byte()

    def stall(self) -> bool:
        """From when the joint was driven for the stall time with a reading that stands, as the protocol counts it."""
        way, place, least = self.run.driven(self.joint), self.run.legs.held[self.joint], MOTION / FULL
        if way != self.way:
            self.way, self.turned = way, self.run.avr.time
        if (way > 0 and place < HIGH - least) or (way < 0 and place > LOW + least):
            self.still += STEP * (0.25 if self.run.avr.time - self.turned < STALL / 4 else 1.0)
        return self.still >= 1.25 * STALL + SETTLING

    def supply(self) -> bool:
        """From when the supply is below 60 % of what it was."""
        return self.run.legs.supply < 0.6 * SUPPLY

    def empty(self) -> bool:
        """From when the last level that was sent is over."""
        return self.run.samples[-1].number + 2 >= self.run.sent * self.run.hold

    def fast(self) -> bool:
        """From when a joint is faster than its limit."""
        return bool(np.max(np.abs(self.run.legs.speed)) > self.run.strike)

    def against(self) -> bool:
        """From when the joint, driven, is the least motion and `NOISE` further back than a healthy one would be."""
        legs, way = self.run.legs, self.run.driven(self.joint)
        healthy = legs.motor(np.asarray(self.run.avr.duties), np.full(3, self.shadow_speed), np.ones(3))
        self.shadow_speed = float(healthy[self.joint])
        if way != self.way:
            self.way, self.from_place = way, float(legs.place[self.joint])
            self.shadow, self.shadow_speed = self.from_place, float(legs.speed[self.joint])
        self.shadow += STEP * self.shadow_speed
        back = (self.from_place - legs.place[self.joint]) * way
        excused = max((self.from_place - self.shadow) * way, 0.0)
        return bool(way and back - excused >= (MOTION + NOISE) / FULL)


Inject = Callable[[Run, int, np.random.Generator], None]


@dataclass(frozen=True)
class Kind:
    """How a fault is let into a run (at a joint), from when on it can be seen, and what the firmware may call it."""

    inject: Inject
    seen: Callable[[Watch], bool]
    reasons: tuple[int, ...]
    before: bool = False  # it is there at START


def damaged(frame: bytes, rng: np.random.Generator) -> bytes:
    """A frame with one byte that is another."""
    data = bytearray(frame)
    data[rng.integers(len(data))] ^= int(rng.integers(1, 256))
    return bytes(data)


def _pull(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.bytes_left = int(rng.integers(0, 80))


def _silence(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.silent = True


def _garble(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.garble = lambda frame: damaged(frame, rng)


def _noise(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.garble = lambda frame: b"".join(rng.integers(1, 256, 5, dtype=np.uint8).tobytes() + b"\0" for _ in range(5))


def _stick(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.legs.held[joint] = float(run.legs.place[joint])


def _unplug(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.legs.held[joint] = float(rng.choice([0.0, 1.0]))  # the wiper, or the end at ground


def _reverse(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.legs.sign[joint] = -1.0


def _unpower(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.legs.supply_decay = STEP / float(rng.uniform(0.001, 0.03))


def _press(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.avr.key = True


def _starve(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.hungry = True


def _stop(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.say(wire.Stop())


def _race(run: Run, joint: int, rng: np.random.Generator) -> None:
    run.legs.gain[joint] *= 12.0
    run.legs.lag[joint] = 0.02


KINDS: dict[str, Kind] = {
    "cable pulled": Kind(_pull, Watch.pulled, (wire.LINK_LOST, wire.STARVED)),
    "host silent": Kind(_silence, Watch.last_byte, (wire.LINK_LOST,)),
    "frames garbled": Kind(_garble, Watch.at_once, (wire.LINK_LOST, wire.NOISY)),
    "noise on the line": Kind(_noise, Watch.at_once, (wire.LINK_LOST, wire.NOISY)),
    "sensor stuck": Kind(_stick, Watch.stall, (wire.STALL,)),
    "sensor unplugged": Kind(_unplug, Watch.at_once, (wire.NO_SENSOR,)),
    # A joint that rests in its end, which it is driven out of, is pushed into it and does not move: that is a stall.
    "motor reversed": Kind(_reverse, Watch.against, (wire.DIRECTION, wire.STALL)),
    "motor reversed from the start": Kind(_reverse, Watch.against, (wire.DIRECTION,), before=True),
    "supply lost": Kind(_unpower, Watch.supply, (wire.SUPPLY_LOST,)),
    "stop key": Kind(_press, Watch.at_once, (wire.STOPPED,)),
    "stop sent": Kind(_stop, Watch.last_byte, (wire.STOPPED,)),
    "levels end early": Kind(_starve, Watch.empty, (wire.STARVED,)),
    "joint too fast": Kind(_race, Watch.fast, (wire.STRIKE, wire.NO_SENSOR)),
}
HEALTHY = "no fault"


@dataclass(frozen=True)
class Outcome:
    """Times [s]: of the fault, from when on it could be seen, and until when an output was on; NaN if it never was so.

    `reason` is what the firmware told, 0 if that did not arrive; `expected` whether it may call the fault so.
    `quiet` is whether the drive stayed off while the host went on.
    """

    began: float
    seen: float
    off: float
    reason: int
    expected: bool
    quiet: bool

    @property
    def late(self) -> float:
        """[s] from when it could be seen until the drive was off; below 0 if it was off before."""
        return self.off - self.seen

    @property
    def met(self) -> bool:
        """Whether the drive was off in time, and stayed so."""
        return bool(self.late <= ALLOWED) and self.quiet and self.expected


def outcome(kind: str, seed: int, longest: float = 6.0) -> Outcome:
    """One run with a fault at a random time; `longest` [s] after which a fault that nobody saw counts as missed."""
    rng = np.random.default_rng([seed, *kind.encode()])
    legs = Legs(rng)
    spec = KINDS[kind]
    levels = random_levels(rng, wire.RING + 40)
    short = kind == "levels end early"
    if short:  # the ring is over after 5 s, and what is sent later does not come
        levels = np.repeat(levels, 4, axis=0)
    with Avr(legs, seed=seed) as avr:
        run = Run(avr, legs, levels, hold=4 if short else HOLD)
        run.prepare()
        joint = int(rng.integers(wire.JOINTS))
        if spec.before:
            spec.inject(run, joint, rng)
        run.start()
        begin = avr.time + (0.0 if spec.before else rng.uniform(0.05, 1.0))
        while avr.time < begin:
            run.go_on()
        watch, began, seen, off = Watch(run, joint), avr.time, np.nan, np.nan
        if not spec.before:
            spec.inject(run, joint, rng)
        while avr.time < began + longest and (np.isnan(off) or np.isnan(seen)):
            run.go_on()
            if np.isnan(seen) and spec.seen(watch):
                seen = avr.time - STEP  # it was so when this millisecond began
            if run.off:
                off = avr.last_on
                seen = off if np.isnan(seen) else seen
                break
        quiet = True
        for _ in range(round(AFTER / STEP)):
            run.go_on()
            quiet = quiet and avr.enabled == 0 and not any(avr.duties)
        reason = run.faults[0].reason if run.faults else 0
        return Outcome(began, seen, off, reason, reason in (0, *spec.reasons), quiet)


@dataclass(frozen=True)
class Healthy:
    """A run without a fault: what the firmware called one (0: nothing), and the samples that are missing of all."""

    reason: int
    missing: int
    samples: int


def healthy(seed: int, seconds: float = 10.0, garbled: float = 0.01) -> Healthy:
    """A run of `seconds` without a fault, on a line that damages the share `garbled` of the host's frames."""
    rng = np.random.default_rng([seed, *HEALTHY.encode()])
    legs = Legs(rng)
    with Avr(legs, seed=seed) as avr:
        run = Run(avr, legs, random_levels(rng, round(seconds / PERIOD / HOLD)))
        run.prepare()
        run.start()
        run.garble = lambda frame: damaged(frame, rng) if rng.random() < garbled else frame
        end = avr.time + seconds + 1.0
        while avr.time < end and not run.faults and not (run.samples and run.samples[-1].state == wire.ENDED):
            run.go_on()
        missing = HOLD * len(run.levels) - len({sample.number for sample in run.samples})
        return Healthy(run.faults[0].reason if run.faults else 0, missing, HOLD * len(run.levels))

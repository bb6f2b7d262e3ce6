"""Faults put into runs of the real firmware: when each could be seen first, and when the drive was off.

The plant is three plain joints: speed follows the duty with a lag, less dry friction, between two ends. One case is one
run of drawn joints with random levels, in simulated time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.rig import wire
from twin.rig.avr import STEP, Avr

FULL = 4092  # counts of a full reading
JOINTS = range(wire.JOINTS)
LOW, HIGH = 0.1, 0.9  # soft limits; the ends of the stroke are 0.04 beyond them
DUTY, STALL, MOTION = 800, 0.25, 25  # limit of duty, stall time [s], least motion [counts]
PERIOD, HOLD, LEVELS_A_FRAME = 0.005, 20, 8  # a sample [s], samples a level, levels of three joints in a frame
BYTE = 10 / wire.BAUD  # [s]
SUPPLY = 0.7  # share of a full reading
AFTER = 0.25  # [s] for which the drive has to stay off
ALLOWED = 0.05  # [s]


class Legs:
    """Three joints: places (3,) as shares of a full reading, and what can go wrong with them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.gain = rng.uniform(0.4, 1.2, 3)  # strokes/s of a whole supply
        self.lag, self.friction = rng.uniform(0.02, 0.08, 3), rng.uniform(0.0, 0.06, 3)
        self.place, self.speed = rng.uniform(0.3, 0.7, 3), np.zeros(3)
        self.sign = np.ones(3)
        self.supply, self.supply_decay = SUPPLY, 0.0
        self.held: dict[int, float] = {}  # what a broken sensor shows
        self.supply_at = 0.0

    def motor(self, duties: np.ndarray, speed: np.ndarray, sign: np.ndarray) -> np.ndarray:
        """The speeds a step later."""
        pull = sign * duties * self.supply / SUPPLY
        wanted = self.gain * np.sign(pull) * np.maximum(np.abs(pull) - self.friction, 0.0)
        return speed + (wanted - speed) * STEP / self.lag

    def __call__(self, duties: object, dt: float) -> list[float]:
        """See `twin.rig.avr.Plant`."""
        self.supply *= 1.0 - self.supply_decay
        self.speed = self.motor(np.asarray(duties, dtype=float), self.speed, self.sign)
        place = self.place + self.speed * dt
        self.place = np.clip(place, LOW - 0.04, HIGH + 0.04)
        self.speed[place != self.place] = 0.0
        shown = [self.held.get(j, float(self.place[j])) for j in JOINTS]
        return [*shown, self.supply]


class Run:
    """A host that arms the board and plays levels, one millisecond a `step`; attributes let a fault into it."""

    def __init__(self, avr: Avr, legs: Legs, levels: np.ndarray, hold: int = HOLD) -> None:
        """Levels (N, 3) [duty], each held for `hold` samples."""
        self.avr, self.legs, self.levels, self.hold = avr, legs, levels, hold
        self.receiver = wire.Receiver(wire.FROM_FIRMWARE)
        self.samples: list[wire.Sample] = []
        self.done: list[wire.Done] = []
        self.faults: list[wire.Fault] = []
        self.identity: wire.Identity | None = None
        self.silent = self.hungry = False
        self.bytes_left: int | None = None  # until the cable is off
        self.garble: Callable[[bytes], bytes] = bytes
        self.strike = 3.0 * float(legs.gain.max())  # strokes/s
        self._sequence = self.sent = self._ticks = 0
        self._waits, self.last_byte = 0, 0.0

    def say(self, message: wire.Plain) -> None:
        """Send a message over what the fault has left of the line."""
        self.put(self.garble(wire.frame(message, self._sequence)))
        self._sequence += 1

    def put(self, data: bytes) -> None:
        """Send bytes."""
        if self.bytes_left is not None:
            data = data[: self.bytes_left]
            self.bytes_left -= len(data)
        self.avr.send(data)
        if data:
            self.last_byte = max(self.last_byte, self.avr.time) + BYTE * len(data)

    def step(self) -> None:
        """A millisecond."""
        sent = self.avr.step()
        if self.bytes_left == 0:
            sent = b""
        for _, message in self.receiver.feed(sent):
            if isinstance(message, wire.Sample):
                self.samples.append(message)
            elif isinstance(message, wire.Done):
                self.done.append(message)
            elif isinstance(message, wire.Fault):
                self.faults.append(message)
            elif isinstance(message, wire.Identity):
                self.identity = message

    def ask(self, message: wire.Plain) -> int:
        """Send a message and wait for its DONE; the reason, 0 if it is done."""
        count = len(self.done)
        self.say(message)
        for _ in range(50):
            self.step()
            if len(self.done) > count:
                return self.done[-1].reason
        raise TimeoutError(f"no answer to {message}")

    def set_up(self, joint: int) -> wire.Setup:
        """The SETUP of a joint."""
        strike = min(round(self.strike * FULL), 65535)
        limits = (round(LOW * FULL), round(HIGH * FULL), strike, DUTY, 60, round(STALL * 1000), MOTION, wire.USED)
        return wire.Setup(joint, *limits)

    def send_levels(self) -> wire.Levels:
        """The next LEVELS."""
        part = self.levels[self.sent : self.sent + LEVELS_A_FRAME]
        first, self.sent = self.sent, self.sent + len(part)
        return wire.Levels(first, len(part), tuple(int(v) for v in part.ravel()))

    def prepare(self) -> None:
        """Everything up to ARM."""
        for _ in range(5):
            self.step()
        for joint in JOINTS:
            assert self.ask(self.set_up(joint)) == 0
        while self.sent < min(len(self.levels), wire.RING):
            assert self.ask(self.send_levels()) == 0
        samples = self.hold * len(self.levels)
        assert self.ask(wire.Arm(round(PERIOD / wire.HALF_MS), samples, self.hold)) == 0

    def start(self) -> None:
        """START; then `go_on` plays."""
        self.samples.clear()
        assert self.ask(wire.Start()) == 0

    def go_on(self) -> None:
        """A millisecond of the run: ALIVE every 10 ms, and levels as the ring has room."""
        self._ticks += 1
        self._waits -= 1
        if not self.silent:
            if self._ticks % round(1000 * wire.ALIVE_EVERY) == 0:
                self.say(wire.Alive())
            room = self.samples[-1].free if self.samples else 0
            if self._waits <= 0 and room >= LEVELS_A_FRAME and self.sent < len(self.levels) and not self.hungry:
                self.say(self.send_levels())
                self._waits = 15  # [ms] until a sample has told the new room
        self.step()

    @property
    def off(self) -> bool:
        """Whether all outputs were off in the last millisecond."""
        return self.avr.time - self.avr.last_on > STEP

    def driven(self, joint: int) -> int:
        """Sign of a drive that should move the joint, else 0."""
        duty = self.avr.duties[joint]
        return int(np.sign(duty)) if abs(duty) * 1024 >= 0.25 * DUTY else 0


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
        if way > 0 and place < HIGH - least or way < 0 and place > LOW + least:
            self.still += STEP * (0.25 if self.run.avr.time - self.turned < STALL / 4 else 1.0)
        return self.still >= STALL

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
        """From when the joint, driven, is the least motion further back than a healthy one since the drive turned."""
        legs, way = self.run.legs, self.run.driven(self.joint)
        healthy = legs.motor(np.asarray(self.run.avr.duties), np.full(3, self.shadow_speed), np.ones(3))
        self.shadow_speed = float(healthy[self.joint])
        if way != self.way:
            self.way, self.from_place = way, float(legs.place[self.joint])
            self.shadow, self.shadow_speed = self.from_place, float(legs.speed[self.joint])
        self.shadow += STEP * self.shadow_speed
        back = (self.from_place - legs.place[self.joint]) * way
        excused = max((self.from_place - self.shadow) * way, 0.0)
        return bool(way and back - excused >= MOTION / FULL)


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
    "motor reversed": Kind(_reverse, Watch.against, (wire.DIRECTION,)),
    "motor reversed from the start": Kind(_reverse, Watch.against, (wire.DIRECTION,), before=True),
    "supply lost": Kind(_unpower, Watch.supply, (wire.SUPPLY_LOST,)),
    "stop key": Kind(_press, Watch.at_once, (wire.STOPPED,)),
    "stop sent": Kind(_stop, Watch.last_byte, (wire.STOPPED,)),
    "levels end early": Kind(_starve, Watch.empty, (wire.STARVED,)),
    "joint too fast": Kind(_race, Watch.fast, (wire.STRIKE, wire.NO_SENSOR)),
}
HEALTHY = "no fault"


def random_levels(rng: np.random.Generator, n: int) -> np.ndarray:
    """Levels (n, 3) [duty] of both signs, every seventh or so zero."""
    size = rng.integers(DUTY // 4, DUTY + 1, (n, 3)) * rng.choice([-1, 1], (n, 3))
    return size * (rng.random((n, 3)) > 0.15)


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

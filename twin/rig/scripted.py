"""A scripted host in front of the simulated board, and three plain joints behind it: all in simulated time.

Speed follows the duty with a lag, less dry friction, between two ends.
"""

from collections.abc import Callable

import numpy as np

from twin.rig import frames, wire
from twin.rig.avr import STEP, Avr

FULL = 4092  # counts of a full reading
JOINTS = range(wire.JOINTS)
LOW, HIGH = 0.1, 0.9  # soft limits; the ends of the stroke are 0.04 beyond them
DUTY, STALL, MOTION = 800, 0.25, 25  # limit of duty, stall time [s], least motion [counts]
PERIOD, HOLD, LEVELS_A_FRAME = 0.005, 20, 8  # a sample [s], samples a level, levels of three joints in a frame
BYTE = 10 / wire.BAUD  # [s]
SUPPLY = 0.7  # share of a full reading


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
        self.receiver = frames.Receiver({**wire.FROM_FIRMWARE})
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

    def say(self, message: wire.Message) -> None:
        """Send a message over what the fault has left of the line."""
        self.put(self.garble(frames.frame(message, self._sequence)))
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

    def ask(self, message: wire.Message) -> int:
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
        return int(np.sign(duty)) if abs(duty) * wire.FULL >= 0.25 * DUTY else 0


def random_levels(rng: np.random.Generator, n: int) -> np.ndarray:
    """Levels (n, 3) [duty] of both signs, every seventh or so zero."""
    size = rng.integers(DUTY // 4, DUTY + 1, (n, 3)) * rng.choice([-1, 1], (n, 3))
    return size * (rng.random((n, 3)) > 0.15)

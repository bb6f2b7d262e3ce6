"""The firmware's rules in Python: states, levels, limits and faults, one call each millisecond.

It stands for `twin/rig/firmware` in front of a simulated plant, and follows docs/rig-protocol.md.
"""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

from twin.rig import wire

TICK = 0.001  # [s] of the control loop
EDGE = 0.01  # of a full reading: no working sensor reads there
STRIKE_TICKS, SUPPLY_TICKS = 8, 5
PARTS = 4  # of the stall time, after each of which it is asked whether the joint moved
COAST, DELAY = 125, 50  # ms: no joint of a leg keeps its speed for longer, and none heeds its drive later
LEAST_SUPPLY = 0.6  # of that at ARM
LONGEST_HOLD = 30_000  # ms of a period


class Plant(Protocol):
    """What the board is wired to; readings in counts of `full`."""

    full: int

    def position(self, joint: int) -> float:
        """What a joint's sensor shows now, without noise [counts]."""

    def reading(self, joint: int) -> int:
        """What is logged of it [counts]."""

    def supply(self) -> int:
        """[counts]."""

    def step(self, duties: list[float]) -> None:
        """A tick with these duties of the three joints."""

    def switch_off(self) -> None:
        """Duties that are on their way are dropped."""


@dataclass
class Joint:
    """A joint in a run: its duty, and what its faults are judged by, as `firmware/safety.c` does it.

    Places are in counts; directions are those in which counts rise. `smooth` and `slow` follow the reading with lags of
    4 and 16 ms. `ahead` is the place furthest with the drive, less what the joint may coast against it at `pace`
    [counts/ms] since the drive has turned. `parts` are its lowest and highest places in the last parts of the stall
    time, and `spent` [ms / PARTS] is the time under drive in the present one.
    """

    setup: wire.Setup
    full: int
    place: float
    duty: int = 0
    total: int = 0
    drive: int = 0
    turned: int = 0
    pace: float = 0.0
    spent: int = 0

    def __post_init__(self) -> None:
        self.past = deque([self.place] * STRIKE_TICKS, maxlen=STRIKE_TICKS)
        self.smooth = self.slow = self.ahead = self.place
        self.parts = deque([[self.place, self.place]], maxlen=PARTS)
        self.quarter = self.setup.stall // 4 + 2 if self.setup.stall // 4 < COAST else COAST
        self.delay = min(self.setup.stall // 60, DELAY)
        self.jump = self.setup.strike / 250.0 + self.full / 64.0

    def next_duty(self, level: int) -> int:
        """Set the duty of the next millisecond; which soft limit cuts it (1 low, 2 high), or 0."""
        s = self.setup
        target = max(-s.duty, min(s.duty, level))
        self.duty += max(-s.slew, min(s.slew, target - self.duty))
        cut = 1 * (self.place <= s.low and self.duty < 0) + 2 * (self.place >= s.high and self.duty > 0)
        if cut:
            self.duty = 0
        return cut

    def fault(self, place: float) -> int:
        """The number of the fault that a new reading shows under the duty of the last millisecond, or 0."""
        before, self.place = self.place, place
        self.past.append(before)
        self.smooth += (place - self.smooth) / 4.0
        self.slow += (place - self.slow) / 16.0
        if not EDGE * self.full < place < (1.0 - EDGE) * self.full or abs(place - before) > self.jump:
            return wire.NO_SENSOR
        if abs(place - self.past[0]) * 1000.0 / STRIKE_TICKS > self.setup.strike:
            return wire.STRIKE
        drive = 0 if 4 * abs(self.duty) < self.setup.duty else 1 if self.duty > 0 else -1
        self.turned += 1
        if drive != self.drive:
            self.drive, self.turned, self.ahead = drive, 0, self.smooth
            self.pace = max((self.slow - self.smooth) * drive / 12.0, 0.0)  # a ramp is 3 ms ahead of one lag, 15 of two
        if drive and self._goes_against():
            return wire.DIRECTION
        return wire.STALL if self._is_stuck() else 0

    def _goes_against(self) -> bool:
        self.ahead -= self.pace * self.drive
        if self.turned >= self.delay:
            self.pace = max(self.pace - (1.0 + 256.0 * self.pace // self.quarter) / 256.0, 0.0)  # in whole 1/256, as C
        if (self.smooth - self.ahead) * self.drive > 0.0:
            self.ahead = self.smooth
        return (self.ahead - self.smooth) * self.drive >= self.setup.motion

    def _is_stuck(self) -> bool:
        s, part = self.setup, self.parts[-1]
        part[0], part[1] = min(part[0], self.smooth), max(part[1], self.smooth)
        at_limit = self.place + s.motion >= s.high if self.drive > 0 else self.place - s.motion <= s.low
        if self.drive and not at_limit:
            self.spent += 1 if self.turned < self.quarter else PARTS
        if self.spent < s.stall:
            return False
        lowest, highest = min(low for low, _ in self.parts), max(high for _, high in self.parts)
        is_whole = len(self.parts) == PARTS
        self.parts.append([self.smooth, self.smooth])
        self.spent = 0
        return is_whole and highest - lowest < s.motion


class Board:
    """The firmware in front of `plant`; `answer` takes messages, `tick` a millisecond while it runs.

    `outbox` collects what it sends. `bad` and `row` are the line's counts of damaged frames, which the line sets.
    """

    def __init__(self, plant: Plant, name: str = "qpal twin") -> None:
        self.plant, self.name = plant, name
        self.state, self.clock = wire.OFF, 0  # [us]
        self.outbox: list[wire.Message] = []
        self.bad = self.idle_number = 0
        self._setups: dict[int, wire.Setup] = {}
        self._forget()
        self._arm: wire.Arm | None = None
        self._joints: dict[int, Joint] = {}

    # What the host says.

    def answer(self, sequence: int, message: wire.Message) -> None:
        """Do what a message says, and answer."""
        if isinstance(message, wire.Alive):
            return
        if isinstance(message, wire.Hello):
            raw = self.name.encode().ljust(16, b"\0")[:16]
            self.outbox.append(
                wire.Identity(wire.VERSION, 1, 0, 0, wire.JOINTS, wire.RING, self.plant.full, 16_000_000, raw)
            )
            return
        reason = 0
        if isinstance(message, wire.Setup):
            reason = self._set_up(message)
        elif isinstance(message, wire.Levels):
            reason = self._take(message)
        elif isinstance(message, wire.Arm):
            reason = self._make_ready(message)
        elif isinstance(message, wire.Start):
            reason = self._start()
        elif isinstance(message, wire.Stop) and self.state in (wire.ARMED, wire.RUNNING):
            self.fail(wire.STOPPED)
        self.outbox.append(wire.Done(message.code, sequence, reason))

    @property
    def used(self) -> list[int]:
        """Numbers of the joints that are used."""
        return sorted(number for number, setup in self._setups.items() if setup.flags & wire.USED)

    def _forget(self) -> None:
        self._levels: list[tuple[int, ...]] = []
        self._played = 0  # levels that have begun

    def _set_up(self, s: wire.Setup) -> int:
        if self.state in (wire.ARMED, wire.RUNNING):
            return wire.STATE
        used = s.flags & wire.USED
        limits = (s.strike, s.duty, s.slew, s.stall, s.motion)
        if s.joint >= wire.JOINTS or (used and (not s.low < s.high < self.plant.full or min(limits) == 0)):
            return wire.VALUE
        if s.duty > wire.FULL:
            return wire.VALUE
        before = self.used
        self._setups[s.joint] = s
        if self.used != before:
            self._forget()
        return 0

    def _take(self, m: wire.Levels) -> int:
        if not self.used or len(m.values) != m.n * len(self.used):
            return wire.SETUP
        if m.index == 0 and self.state != wire.RUNNING:
            self._forget()
        if m.index > len(self._levels):
            return wire.GAP
        if any(abs(value) > wire.FULL for value in m.values):
            return wire.VALUE
        rows = list(zip(*[iter(m.values)] * len(self.used), strict=True))[len(self._levels) - m.index :]
        if len(rows) > self.room:
            return wire.ROOM
        self._levels += rows
        return 0

    @property
    def room(self) -> int:
        """Levels for which the ring has room."""
        return wire.RING - (len(self._levels) - self._played)

    def _make_ready(self, arm: wire.Arm) -> int:
        if self.state == wire.RUNNING:
            return wire.STATE
        if not self.used:
            return wire.SETUP
        if arm.period % 2 or not 2 <= arm.period <= 2 * LONGEST_HOLD or 0 in (arm.samples, arm.hold):
            return wire.VALUE
        full = self.plant.full
        if any(not EDGE * full < self.plant.position(j) < (1.0 - EDGE) * full for j in self.used):
            return wire.SENSOR
        if len(self._levels) < min(-(-arm.samples // arm.hold), wire.RING) or self._played:
            return wire.FEW
        self._arm, self.state, self._supply = arm, wire.ARMED, self.plant.supply()
        return 0 if self._supply else wire.NO_SUPPLY

    def _start(self) -> int:
        if self.state != wire.ARMED:
            return wire.STATE
        self._joints = {j: Joint(self._setups[j], self.plant.full, self.plant.position(j)) for j in self.used}
        self.state, self._ticks, self._low_supply, self._cuts = wire.RUNNING, 0, 0, 0
        return 0

    # What happens in time.

    @property
    def hungry(self) -> bool:
        """Whether the next tick needs a level that has not come."""
        if self.state != wire.RUNNING or self._arm is None:
            return False
        number, within = divmod(self._ticks, self._arm.period // 2)
        return within == 0 and number % self._arm.hold == 0 and number // self._arm.hold >= len(self._levels)

    def tick(self) -> None:
        """A millisecond of a run."""
        assert self._arm is not None
        number, within = divmod(self._ticks, self._arm.period // 2)
        if self.hungry:
            self.fail(wire.STARVED)
            return
        if within == 0:
            self._played = number // self._arm.hold + 1
            self._begun, self._cuts = self.clock, 0
            self._readings = [self.plant.reading(j) for j in self._joints]
            self._bus = self.plant.supply()
        duties = [0.0] * wire.JOINTS
        for level, (j, joint) in zip(self._levels[self._played - 1], self._joints.items(), strict=True):
            if reason := joint.fault(self.plant.position(j)):
                self.fail(reason, j)
                return
            self._cuts |= joint.next_duty(level) << 2 * j
            joint.total = joint.duty + (joint.total if within else 0)
            duties[j] = -joint.duty if joint.setup.flags & wire.REVERSED else joint.duty
        self._low_supply = self._low_supply + 1 if self.plant.supply() < LEAST_SUPPLY * self._supply else 0
        if self._low_supply >= SUPPLY_TICKS:
            self.fail(wire.SUPPLY_LOST)
            return
        self.plant.step(duties)
        self._ticks += 1
        self.clock = (self.clock + 1000) % 2**32
        if within == self._arm.period // 2 - 1:
            self._end_sample(number)

    def _end_sample(self, number: int) -> None:
        assert self._arm is not None
        ticks = self._arm.period // 2
        if number == self._arm.samples - 1:
            self._off(wire.ENDED)
        duties = [round(joint.total / ticks) for joint in self._joints.values()]
        pairs = tuple(zip(self._readings, duties, strict=True))
        state, free = self.state, self.room
        self.outbox.append(
            wire.Sample(number, self._begun, pairs, self._bus, state, self._cuts, free, min(self.bad, 255))
        )

    def idle_sample(self) -> None:
        """Send what all sensors read, with the drive off."""
        pairs = tuple((self.plant.reading(j), 0) for j in range(wire.JOINTS))
        self.outbox.append(
            wire.Sample(
                self.idle_number, self.clock, pairs, self.plant.supply(), self.state, 0, self.room, min(self.bad, 255)
            )
        )
        self.idle_number = (self.idle_number + 1) % 2**16

    def fail(self, reason: int, joint: int = wire.NO_JOINT) -> None:
        """Drive off, and say why, three times since a frame may be lost."""
        self._off(wire.FAILED)
        self.outbox += [wire.Fault(reason, joint, self.clock)] * 3

    def _off(self, state: int) -> None:
        self.state, self.idle_number = state, 0
        self.plant.switch_off()

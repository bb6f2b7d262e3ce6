"""Play goals on a servo, of which the host is the clock."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import Range
from sysid.channels.reading import sample
from sysid.formats import read_table
from twin.rig.bus.line import Bus, Garbled, Refused, Silent, State
from twin.rig.bus.recording import EXTRA, Recording
from twin.rig.bus.registers import TICK, WATCHDOG_UNIT
from twin.rig.bus.servo import About, Servo, about, errors_of, rest
from twin.rig.link import Lost
from twin.rig.run import MOST, SHORTEST, Early, Input

MISSES = 0.1  # [s] without an answer, after which the torque goes off; at least three samples
WATCHDOG = 0.1  # [s] of the servo's own watchdog, at least three samples
FULL = 0.9  # of the largest drive: it may stall
MOTION = np.deg2rad(2.0)  # less is none
CURRENT_TIME = 0.1  # [s] above the largest current
OFF_TRIES = 30
TRIES_OF_PACE = 10
PACE = 0.02  # [s] of the goals on the way to the first one


def read_goals(path: str | Path) -> Input:
    """The goals [rad] in a file with a clock and an angle, in rad or deg.

    Raises InputError where no column is the goal beyond doubt, or it is no angle.
    """
    table = read_table(path)
    mapping = guess(table, Given()).mapping.model_copy(update={"output": (), "other": (), "range": Range()})
    if len(mapping.input) != 1 or not mapping.input[0].column:
        raise InputError(
            f"{path}: no column is the one goal to play; give a file with the columns time [s] and goal [deg]"
        )
    signals = sample(table, mapping)
    (u,) = signals.input
    if u.unit != "rad":
        raise InputError(
            f"{path}: the input {u.column!r} is in {u.unit or 'no unit'}, and a servo takes angles; name it so that it "
            "says [deg] or [rad]"
        )
    return Input(u.values, signals.Ts, str(path))


def check_goals(given: Input, servo: Servo) -> np.ndarray:
    """The goals (N,) [ticks], as slow as the slew allows. Raises InputError, before anything moves, for others."""
    u, Ts, N, name = given.u, given.Ts, len(given.u), given.source or "the input"
    if not np.isfinite(u).all():
        raise InputError(f"{name}: sample {int(np.argmin(np.isfinite(u)))} is not a number; every goal is needed")
    outside = np.maximum(servo.soft_low - u, u - servo.soft_high)
    worst = int(np.argmax(outside))
    if outside[worst] > 0.5 * TICK:
        low, high = np.rad2deg(servo.soft_low), np.rad2deg(servo.soft_high)
        raise InputError(
            f"{name} has the goal {np.rad2deg(u[worst]):.4g} deg at {worst * Ts:.4g} s, and the soft limits are "
            f"{low:.4g} and {high:.4g} deg; keep within, or change soft_low and soft_high in the rig's file"
        )
    if not SHORTEST <= N <= MOST:
        raise InputError(f"{name} has {N} samples; the rig plays {SHORTEST} to {MOST} at once: cut it, or hold longer")
    goals, step = np.array(u, dtype=float), servo.slew * Ts
    for k in range(1, N):
        goals[k] = np.clip(u[k], goals[k - 1] - step, goals[k - 1] + step)
    return servo.position(goals)


class _Player:
    def __init__(self, bus: Bus, servo: Servo, known: About, goals: np.ndarray, Ts: float, progress: Any) -> None:
        self.bus, self.servo, self.known, self.progress = bus, servo, known, progress
        N, nan = len(goals), np.nan
        more = {name: np.full(N, nan) for name in EXTRA}
        self.made = Recording(goals.copy(), np.full(N, nan), np.full(N, nan), np.full(N, nan), Ts, more)
        self.given, self.Ts, self.seen, self.active = goals, Ts, 0, False
        self.heard = self.driven = self.free = bus.clock.now()
        self.place: float | None = None
        self.held: dict[str, int] = {}

    def put(self, name: str, value: int) -> bool:
        """Write a register if the servo has it."""
        register = self.bus.family.register(name, self.known.model)
        if register is not None:
            self.bus.write(self.servo.number, register, value)
        return register is not None

    def begin(self) -> None:
        """At rest, torque on where it stands, and slowly to the first goal."""
        bus, number = self.bus, self.servo.number
        place = rest(bus, number, self.known.model)
        self._check_pace()
        if (
            not self.servo.soft_low - self.servo.beyond
            < self.servo.angle(place)
            < self.servo.soft_high + self.servo.beyond
        ):
            raise InputError(
                f"{bus.port}: servo {number} is at {np.rad2deg(self.servo.angle(place)):.1f} deg, outside its soft "
                "limits; bring it inside by hand"
            )
        for name in ("profile_speed", "profile_acceleration"):
            self.held[name] = self.known.registers[name]
            self.put(name, 0)
        self.put("watchdog", 0)
        self.put("goal", place)
        self.active = True
        self.put("torque", 1)
        self.put("goal", place)
        self.put("watchdog", int(np.ceil(max(WATCHDOG, 3.0 * self.Ts) / WATCHDOG_UNIT)))
        way = int(self.given[0]) - place
        steps = int(np.ceil(abs(way) * TICK / (self.servo.approach * PACE)))
        start = bus.clock.now()
        self.heard = self.driven = self.free = start
        for k in range(1, steps + round(0.5 / PACE)):
            bus.clock.wait_until(start + k * PACE)
            self._turn(place + round(way * min(k / max(steps, 1), 1.0)))

    def _check_pace(self) -> None:
        """Raises InputError where the bus is too slow for the goals."""
        bus, times = self.bus, []
        for _ in range(TRIES_OF_PACE):
            with suppress(Silent, Garbled):
                state = bus.state(self.servo.number, self.known.model)
                times.append(state.answered - state.asked)
        turn = 2.0 * float(np.median(times)) if times else np.inf
        if turn > 0.8 * self.Ts:
            raise InputError(
                f"{bus.port}: a goal and a reading take {1e3 * turn:.1f} ms and a sample {1e3 * self.Ts:g} ms; give "
                f"samples of {np.ceil(1.3e3 * turn):g} ms or more, a faster bus, or a USB adapter with a latency timer "
                "of 1 ms"
            )
        bus.answer = float(np.clip(2.0 * turn, 3e-3, 0.3 * self.Ts))

    def play(self) -> None:
        """To the last goal; raises Early where it ends before."""
        clock, made, Ts = self.bus.clock, self.made, self.Ts
        start = clock.now() + Ts
        for k, goal in enumerate(self.given):
            clock.wait_until(start + k * Ts)
            if clock.now() > start + (k + 0.5) * Ts:  # the host was elsewhere
                made.goals[k] = made.goals[k - 1] if k else goal
                self.seen = k + 1
                continue
            made.sent[k] = clock.now() - start
            state = self._turn(int(goal), k)
            if state is not None:
                made.positions[k] = state.position
                made.read[k] = 0.5 * (state.asked + state.answered) - start
                for name in EXTRA:
                    made.more[name][k] = getattr(state, name)
            self.seen = k + 1
            if k % 20 == 0:
                self.progress(k / len(self.given))

    def _turn(self, goal: int, k: int | None = None) -> State | None:
        """Send a goal and read the servo; None if no answer came. Raises Early for what is wrong."""
        bus, made, confirmed, state = self.bus, self.made, False, None
        try:
            with self._counted():
                bus.write(self.servo.number, bus.family.registers["goal"], goal, tries=1)
                confirmed = True
        except Refused as refused:  # so a Dynamixel says that its watchdog has stopped it
            raise Early(f"{refused}; a Dynamixel whose host was silent for too long takes no goal") from None
        with self._counted():
            state = bus.state(self.servo.number, self.known.model)
        now = bus.clock.now()
        if state is None:
            made.unconfirmed += not confirmed and k is not None
            if now - self.heard > max(MISSES, 3.0 * self.Ts):
                raise Early("the servo does not answer any more")
            return None
        self.heard = now
        if k is not None and state.goal != goal:
            made.goals[k] = state.goal
            made.other_goals += 1
        self._guard(state, now)
        return state

    @contextmanager
    def _counted(self) -> Iterator[None]:
        """Counts an answer that does not come, or comes garbled."""
        try:
            yield
        except Garbled:
            self.made.garbled += 1
        except Silent:
            self.made.silent += 1

    def _guard(self, state: State, now: float) -> None:
        """Raises Early for a state in which the torque has to go off."""
        servo = self.servo
        if state.error:
            raise Early(f"the servo reports {errors_of(self.bus.family, state.error)}")
        if state.temperature >= servo.hottest:
            raise Early(f"the servo has {state.temperature:.0f} C, and the limit is {servo.hottest:.0f} C")
        angle = float(servo.angle(np.array(state.position)))
        if not servo.soft_low - servo.beyond <= angle <= servo.soft_high + servo.beyond:
            raise Early(f"the joint is at {np.rad2deg(angle):.1f} deg, beyond its soft limits")
        if servo.largest_current is None or not abs(state.current) > servo.largest_current:
            self.free = now
        elif now - self.free > CURRENT_TIME:
            raise Early(f"the servo draws {abs(state.current):.2f} A, and the limit is {servo.largest_current:.2f} A")
        moved = self.place is None or abs(angle - self.place) > MOTION
        if moved or not abs(state.load) > FULL * self.known.loop["largest_drive"]:
            self.place, self.driven = angle, now
        elif now - self.driven > servo.stall:
            raise Early("it does not move at its largest drive (stall)")

    def off(self) -> float | None:
        """Torque off, said until the servo confirms it; returns the time that this took [s], None if it did not."""
        began, register = self.bus.clock.now(), self.bus.family.registers["torque"]
        self.bus.answer = max(self.bus.answer, 0.01)
        for _ in range(OFF_TRIES):
            try:
                self.bus.write(self.servo.number, register, 0, tries=1)
                if self.bus.read(self.servo.number, register, tries=1) == 0:
                    return self.bus.clock.now() - began
            except (Silent, Garbled, KeyboardInterrupt):
                continue
            except (Lost, InputError):
                return None
        return None

    def restore(self) -> None:
        """The watchdog off, and the profile as it was."""
        with suppress(InputError):
            self.put("watchdog", 0)
            for name, value in self.held.items():
                self.put(name, value)


def play(
    bus: Bus, servo: Servo, goals: np.ndarray, Ts: float, progress: Callable[[float], None] = lambda share: None
) -> tuple[Recording, About]:
    """Play goals (N,) [ticks], each for Ts [s]; the torque is off at the end, however it comes.

    An error of the servo, heat, current, a stall, a place beyond the limits, a lost line and Ctrl-C end the run early
    and leave what was recorded. Raises InputError where the run cannot begin.
    """
    known = about(bus, servo.number, servo.model)
    player = _Player(bus, servo, known, np.asarray(goals), Ts, progress)
    made = player.made
    try:
        player.begin()
        player.play()
    except (Early, Lost) as early:
        made.reason = str(early)
        if isinstance(early, Lost) and not player.active:
            raise
    except KeyboardInterrupt:
        made.reason, made.interrupted = "it was stopped by hand", True
    finally:
        if player.active:
            made.off = player.off()
            player.restore()
    n = player.seen
    for name in ("goals", "positions", "sent", "read"):
        setattr(made, name, getattr(made, name)[:n])
    made.more = {name: values[:n] for name, values in made.more.items()}
    return made, known

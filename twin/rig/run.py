"""Play an input on a joint of the rig and bring back its log: levels out with flow control, samples in."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import Range
from sysid.channels.reading import sample
from sysid.formats import read_table
from twin.log import Log
from twin.parameters import JOINTS
from twin.rig import wire
from twin.rig.calibration import Calibration
from twin.rig.link import POLL, Link, Lost

MOST = 2**16 - 1  # samples of a run
SHORTEST = 10
QUICKEST = 0.005  # [s] of a sample: SAMPLE takes 2 ms on the line, and LEVELS go the other way meanwhile
SILENCE = 1.0  # [s] without a frame in a run
ATTEMPTS = 10  # to begin a run, which two frames that are not repeated do
FRAME = (wire.PAYLOAD - 3) // 2  # levels of one joint in a frame


@dataclass(frozen=True)
class Input:
    """An input u (N,) [V], each value held for Ts [s]; `source` says where it is from."""

    u: np.ndarray
    Ts: float
    source: str = ""


@dataclass(frozen=True)
class Recording:
    """What came back of a run of N levels [duty]: readings (n,) [counts], nan where the frame was lost, and duties (n,)
    as played, those sent where the frame was lost.

    `reason` says why it ended early, empty if it did not; `fault` is the firmware's number of it, 0 if it has none.
    """

    counts: np.ndarray
    duty: np.ndarray
    Ts: float
    limits: np.ndarray
    supply: np.ndarray
    bad: int
    missing: int
    reason: str = ""
    fault: int = 0
    interrupted: bool = False

    @property
    def lost(self) -> np.ndarray:
        """Numbers of the samples that did not come."""
        return np.flatnonzero(np.isnan(self.counts))

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.counts) * self.Ts


def read_input(path: str | Path, given: Given = Given()) -> Input:  # noqa: B008 - it is frozen
    """The input in a file with a clock and a voltage: a design, a log of the rig or of the twin, a table of one's own.

    Columns and the sampling time are guessed as far as they are not `given`. Raises InputError where no column is the
    input, or none or more than one the clock, beyond doubt, where a level is missing, and where it is not in volts.
    """
    table = read_table(path)
    guessed = guess(table, given)
    mapping = guessed.mapping.model_copy(update={"output": (), "other": (), "range": Range()})
    # An input needs no output, so what is unclear of that does not matter.
    if unclear := [text for text in guessed.unclear if any(name in text for name in ("--input", "--time", "--ts"))]:
        raise InputError(f"{path}: {unclear[0].partition(' (in a mapping')[0]}")
    if len(mapping.input) != 1 or not mapping.input[0].column:
        raise InputError(
            f"{path}: no column is the one voltage to play; give a file with the columns time [s] and u [V], as qpal "
            "design writes it"
        )
    try:
        signals = sample(table, mapping)
    except InputError as error:  # its remedies are those for logs, of which some samples may be filled
        raise InputError(f"{str(error).partition('; ')[0]}; {_WHOLE}") from None
    (u,), steps = signals.input, signals.sampling.steps
    if len(signals.lengths) > 1:  # a log may pause; what is played may not
        raise InputError(f"{path}: its clock pauses or starts again, {len(signals.lengths)} parts; {_WHOLE}")
    if signals.sampling.interpolated or signals.sampling.loose:
        raise InputError(f"{path}: its steps of time are {steps.min():.4g} to {steps.max():.4g} s; {_WHOLE}")
    if u.missing.any():
        raise InputError(f"{path}: sample {int(np.argmax(u.missing))} has no level; {_WHOLE}")
    if u.unit != "V":
        raise InputError(f"{path}: the input {u.column!r} is in {u.unit or 'no unit'}; name it so that it says [V]")
    return Input(u.values, signals.Ts, str(path))


_WHOLE = "an input has a level for each sample and equal steps of time: correct the file"


def check_input(given: Input, calibration: Calibration) -> np.ndarray:
    """The levels (N,) [duty] of an input. Raises InputError, before anything moves, for one beyond the limits."""
    u, Ts, N = given.u, given.Ts, len(given.u)
    name = given.source or "the input"
    if not np.isfinite(u).all():
        raise InputError(f"{name}: sample {int(np.argmin(np.isfinite(u)))} is not a number; every level is needed")
    worst = int(np.argmax(np.abs(u)))
    if abs(u[worst]) > calibration.largest * (1.0 + 1e-9):
        raise InputError(
            f"{name} reaches {u[worst]:.4g} V at {worst * Ts:.4g} s, and the rig's largest input is "
            f"{calibration.largest:g} V; design it with --volts {calibration.largest:g}"
        )
    if not SHORTEST <= N <= MOST:
        raise InputError(f"{name} has {N} samples; the rig plays {SHORTEST} to {MOST} at once: cut it, or hold longer")
    if abs(Ts * 1e3 - round(Ts * 1e3)) > 1e-3 or not QUICKEST <= Ts <= 30.0:
        raise InputError(
            f"{name} has a sample every {Ts:.6g} s; the rig plays whole milliseconds from {QUICKEST * 1e3:g} ms on: "
            "resample it"
        )
    return calibration.levels(u)


class Early(Exception):  # noqa: N818 - the end of a run
    """A run ends before its time: the sentence, and the number of the fault. What watches a link may raise it."""

    def __init__(self, reason: str, fault: int = 0) -> None:
        super().__init__(reason)
        self.fault = fault


class _Player:
    """One run on a link: it begins, sends levels as there is room, and collects samples."""

    def __init__(self, link: Link, levels: np.ndarray, Ts: float, progress: Callable[[float], None]) -> None:
        self.link, self.levels, self.Ts, self.progress = link, [int(v) for v in levels], Ts, progress
        N = len(levels)
        self.counts, self.limits, self.supply = np.full(N, np.nan), np.zeros(N, dtype=int), np.full(N, np.nan)
        self.duty = np.array(levels, dtype=float)
        self.seen, self.sent, self.room, self.ended = 0, 0, 0, False
        self.heard, self.empty = time.monotonic(), 0  # reads without a frame, one after the other

    def begin(self, setup: wire.Setup) -> None:
        """Limits, the first levels, ARM and START. Raises InputError for a refusal."""
        link, N = self.link, len(self.levels)
        for _ in range(ATTEMPTS):
            _done(link.ask(wire.Stop()), "STOP")
            for joint in range(link.identity.joints):
                unused = wire.Setup(joint, *[0] * 8)
                _done(link.ask(setup if joint == setup.joint else unused), "the limits")
            self.sent = 0
            while self.sent < min(N, wire.RING):
                _done(self._send_levels(min(N, wire.RING) - self.sent), "levels")
            # ARM and START are never said twice: where an answer is lost, all begins anew from STOP.
            reason = link.ask(wire.Arm(round(self.Ts / wire.HALF_MS), N, 1), repeat=False, seconds=0.5)
            if reason is None:
                continue
            _done(reason, "ARM")
            link.forget()
            reason = link.ask(wire.Start(), repeat=False, seconds=0.5)
            if reason is None and not self._runs():
                continue
            _done(reason or 0, "START")
            self.heard = time.monotonic()
            return
        raise InputError(f"{link.port}: the run could not begin; too many frames are lost on this line")

    def _runs(self) -> bool:
        """Whether samples of a run come although the answer to START did not."""
        end = time.monotonic() + 0.3 + self.Ts
        while time.monotonic() < end and not self.seen:
            self.listen()
        return self.seen > 0

    def play(self) -> None:
        """To the end of the run; raises Early if that comes before its time."""
        told = 0.0
        while not self.ended:
            self.listen()
            while self.sent < len(self.levels) and self.room >= min(FRAME, len(self.levels) - self.sent):
                if self._send_levels(self.room) not in (0, wire.ROOM):
                    break  # the firmware says why by itself
            if self.seen > told + 0.01 * len(self.levels):
                told = self.seen
                self.progress(self.seen / len(self.levels))
            # Where this process itself had no time, the rig was not silent for as many reads.
            if time.monotonic() - self.heard > SILENCE + 5.0 * self.Ts and self.empty > 0.5 * SILENCE / POLL:
                raise Early("the rig went silent")

    def _send_levels(self, room: int) -> int | None:
        n = min(FRAME, room, len(self.levels) - self.sent)
        reason = self.link.ask(wire.Levels(self.sent, n, tuple(self.levels[self.sent : self.sent + n])))
        if reason == 0:
            self.sent += n
        self.room = self.room - n if reason == 0 else 0
        return reason

    def listen(self) -> None:
        """Take what has come."""
        self.empty += 1
        for message in self.link.receive():
            self.heard, self.empty = time.monotonic(), 0
            if isinstance(message, wire.Fault):
                if message.clock == self.link.fault_clock:
                    continue
                self.link.fault_clock = message.clock
                raise Early(wire.FAULTS.get(message.reason, f"fault {message.reason}"), message.reason)
            if not isinstance(message, wire.Sample):
                continue
            if len(message.joints) == 1:
                self._take(message)
            elif message.state == wire.ENDED:
                self.ended = True
            elif message.state == wire.FAILED:
                raise Early("of a fault whose message was lost")
            elif message.state == wire.OFF:
                raise Early("the board has begun anew: it lost its power or was reset")

    def _take(self, message: wire.Sample) -> None:
        k = message.number
        if k >= len(self.levels):
            return
        self.counts[k], self.duty[k] = message.joints[0]
        self.limits[k], self.supply[k], self.room = message.limits, message.supply, message.free
        self.seen, self.ended = k + 1, message.state == wire.ENDED

    def recording(self, error: Early | Lost | KeyboardInterrupt | None, before: tuple[int, int]) -> Recording:
        """What came until now."""
        for message in self.link.forget():
            if isinstance(message, wire.Sample) and len(message.joints) == 1:
                self._take(message)
        n = len(self.levels) if self.ended else self.seen
        stopped = isinstance(error, KeyboardInterrupt)
        return Recording(
            self.counts[:n],
            self.duty[:n],
            self.Ts,
            self.limits[:n],
            self.supply[:n],
            self.link.bad - before[0],
            self.link.missing - before[1],
            "it was stopped by hand" if stopped else str(error or ""),
            getattr(error, "fault", 0),
            stopped,
        )


def play(
    link: Link,
    setup: wire.Setup,
    levels: np.ndarray,
    Ts: float,
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Play levels (N,) [duty], each for Ts [s], on the joint of `setup`; the drive is off at the end, however it comes.

    A fault, a lost port and Ctrl-C end the run early and leave what was recorded. Raises InputError where the rig
    refuses to begin.
    """
    player, before = _Player(link, levels, Ts, progress), (link.bad, link.missing)
    error: Early | Lost | KeyboardInterrupt | None = None
    with link.alive():
        try:
            player.begin(setup)
            player.play()
        except (Early, KeyboardInterrupt) as early:
            error = early
        except Lost as lost:
            if not player.seen:
                raise
            error = lost
    recording = player.recording(error, before)
    link.rig_seconds += recording.duration
    return recording


def _done(reason: int | None, what: str) -> None:
    """Raises InputError for a refusal."""
    if reason is None:
        raise InputError(f"the rig does not answer to {what}; check the cable, and that its stop key is released")
    if reason:
        raise InputError(f"the rig refuses {what}: {wire.REFUSALS.get(reason, f'reason {reason}')}")


def log_of(recording: Recording, calibration: Calibration, link: Link, source: str = "") -> Log:
    """The log of a recording that has just come over `link`; see `log_of_run`."""
    return log_of_run(recording, calibration, link.identity.release, link.port, source)


def log_of_run(recording: Recording, calibration: Calibration, firmware: str, port: str, source: str = "") -> Log:
    """The log of a recording: voltages as played, angles, and what a reader has to know of the rig.

    A lost sample has no angle: it is nan, and its number is in `meta["filled"]`.
    """
    lost = recording.lost
    supply = recording.supply[~np.isnan(recording.supply)]
    first_supply = supply[0] if len(supply) else np.nan
    rig: dict[str, Any] = {
        "firmware": firmware,
        "port": port,
        "supply": calibration.supply,
        "lowest_supply_percent": round(100.0 * float(supply.min() / first_supply), 1) if len(supply) else None,
        "damaged_frames": recording.bad,
        "lost_frames": recording.missing,
        "samples_at_a_limit": int(np.count_nonzero(recording.limits)),
        "ended_early": recording.reason or None,
    }
    notes = []
    if len(lost):
        notes.append(
            f"{len(lost)} of {len(recording.counts)} samples were lost on the line: they are marked as missing"
        )
    if rig["samples_at_a_limit"]:
        notes.append(f"the soft limits cut the motor in {rig['samples_at_a_limit']} samples")
    if recording.reason:
        notes.append(f"the run ended early: {recording.reason}")
    meta = {"source": "rig", "excitation": source, "mode": "voltage", "rig": rig, "notes": notes}
    meta |= {"filled": lost.tolist()} if len(lost) else {}
    joint = calibration.joint if calibration.joint in JOINTS else ""
    return Log(calibration.volts(recording.duty), calibration.angle(recording.counts), recording.Ts, None, joint, meta)

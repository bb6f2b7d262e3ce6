"""Before the first run: how a joint is wired, by small pulses, and where its ends are, by slow runs into them."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from twin.rig import wire
from twin.rig.calibration import RESISTOR, SUPPLY_OFF, USB, Calibration
from twin.rig.link import Link
from twin.rig.run import Recording, play

TS = 0.02  # [s]
PULSE = 0.8  # [s]
SHARES = tuple(np.round(np.arange(0.15, 1.01, 0.1), 2))  # of the supply, of pulses one after the other
SEEN = 0.004  # of a full reading: a motion
EXTRA = 0.25  # of the supply, above what moves a joint, for the runs to its ends
LONGEST = 90.0  # [s] of such a run
STALL, STALL_MOTION = 1.5, 0.004  # [s], and share of a full reading: such a run ends where the joint stands
NARROW = 0.03  # of a full reading: less is no way between two ends
FASTER = 2.5  # limit of speed, in mean speeds at full voltage
DRY = 0.85  # of the share that moved the joint is its friction: shares go up in steps
SOFT = 0.5  # of the least motion: how far beyond its ends the soft limits lie


@dataclass(frozen=True)
class Readings:
    """What the sensors show at rest: mean and standard deviation (joints,) [counts], and the supply [counts]."""

    mean: np.ndarray
    std: np.ndarray
    supply: float


def read_sensors(link: Link, samples: int = 8) -> Readings:
    """The sensors at rest. Raises InputError if the rig sends none."""
    rows: list[list[int]] = []
    end = time.monotonic() + 4.0 * samples / wire.IDLE_RATE
    link.forget()
    while len(rows) < samples and time.monotonic() < end:
        link.send(wire.Alive())
        for message in link.receive():
            if isinstance(message, wire.Sample) and len(message.joints) == wire.JOINTS:
                rows.append([*(reading for reading, _ in message.joints), message.supply])
    link.rig_seconds += samples / wire.IDLE_RATE
    if len(rows) < 2:
        raise InputError(f"{link.port}: the rig sends no readings; check its firmware")
    mean, std = np.mean(rows, axis=0), np.std(rows, axis=0)
    return Readings(mean[:-1], std[:-1], float(mean[-1]))


def board_on(link: Link, seed: int | None) -> str:
    """Who answers: name and version of the firmware, and the seed of an emulated leg, if it is one."""
    return link.identity.release + ("" if seed is None else f", seed {seed}")


def check_rig(link: Link, calibration: Calibration, board: str, again: str) -> None:
    """Raises InputError, before anything moves, where the rig is another than that of its calibration: `board` answers
    instead, or its supply is another by more than a good divider may be off. `again` is the command that wires it."""
    if calibration.board not in ("", board):
        raise InputError(
            f"this calibration is of another board: {calibration.board}; here answers {board}: wire it by {again}, or "
            "give the port of that board"
        )
    volts = read_sensors(link).supply / link.identity.full * calibration.supply_full
    if abs(volts - calibration.supply) > SUPPLY_OFF * calibration.supply:
        raise InputError(
            f"the supply measures {volts:.1f} V and should have {calibration.supply:g} V; {SUPPLY_OFF:.0%} off is "
            f"allowed, by its divider of resistors of {RESISTOR:.0%} and the {USB:.0%} of USB: switch it on, or "
            "correct the supply, or supply_full for another divider"
        )


def find_wiring(link: Link, calibration: Calibration, say: Callable[[str], None]) -> Calibration:
    """The calibration with the motor's direction, and the shares of the supply that move the joint either way.

    Pulses both ways grow until the joint moves. Raises InputError for a sensor at the edge of its range, a joint that
    does not move, and another joint that moves instead.
    """
    full, channel = link.identity.full, calibration.channel
    first = read_sensors(link)
    place, noise = first.mean[channel], first.std[channel]
    if not 0.02 * full < place < 0.98 * full:
        raise InputError(
            f"joint {channel} reads {place:.0f} of {full} counts, the edge of its range; check the potentiometer's "
            "three wires, or give another --channel"
        )
    say(f"joint {channel} reads {place:.0f} of {full} counts, noise {noise:.1f}")
    moved: dict[int, float] = {}
    forward = 0  # counts per positive duty
    for share in SHARES:
        for way in (1, -1):
            if way in moved:
                continue
            before = read_sensors(link).mean
            recording = _pulse(link, calibration, way * share)
            change = read_sensors(link).mean - before
            if recording.fault:
                raise InputError(f"the pulse of {way * share:+.0%} ended early: {recording.reason}")
            if abs(change[channel]) >= SEEN * full:
                moved[way] = float(share)
                forward = int(np.sign(change[channel])) * way
                say(f"{way * share:+.0%} of the supply moves it by {change[channel]:+.0f} counts")
            elif np.abs(change).max() >= SEEN * full:
                other = int(np.argmax(np.abs(change)))
                raise InputError(
                    f"the motor of joint {channel} moves the sensor of joint {other}; exchange the wires, or give "
                    f"--channel {other}"
                )
        if len(moved) == 2:
            break
    if not moved:
        raise InputError(f"joint {channel} does not move at full duty; check the motor's wires and its supply")
    ways = {way: moved.get(way, moved.get(-way, 1.0)) for way in (1, -1)}
    say("the motor's sign is reversed" if forward < 0 else "the motor's sign is as the sensor's")
    return calibration.model_copy(
        update={"motor_reversed": forward < 0, "moves_up": ways[forward], "moves_down": ways[-forward]}
    )


def _pulse(link: Link, calibration: Calibration, share: float) -> Recording:
    """A short pulse; the limits of the joint are not known yet, so that no motion is a fault."""
    raw = calibration.model_copy(update={"motor_reversed": False})
    setup = raw.raw_setup(link.identity.full, abs(share), stall=10.0, motion=0.25)
    n = round(PULSE / TS)
    levels = np.r_[np.full(n, round(share * wire.FULL)), np.zeros(n, dtype=int)]
    return _move(link, setup, levels)


def _move(link: Link, setup: wire.Setup, levels: np.ndarray) -> Recording:
    """Play levels of which no log is kept. Raises KeyboardInterrupt after Ctrl-C, and InputError where the rig is gone;
    a fault is in the recording."""
    recording = play(link, setup, levels, TS)
    if recording.interrupted:
        raise KeyboardInterrupt
    if recording.reason and not recording.fault:
        raise InputError(f"{recording.reason}; the drive is off")
    return recording


@dataclass(frozen=True)
class Ends:
    """Readings [counts] and angles [rad] at the two ends, and the time [s] from the low one to the high one at `share`
    of the supply."""

    low: float
    high: float
    low_angle: float
    high_angle: float
    seconds: float
    share: float


def find_ends(
    link: Link, calibration: Calibration, say: Callable[[str], None], angle: Callable[[str, float], float]
) -> Ends:
    """Run slowly into both ends, then to the middle. Raises InputError where there is no way between them.

    While the joint stands at an end, `angle` gets its name ("low" or "high") and its reading [counts], and gives its
    angle [rad].
    """
    low, _, _ = _run_to_end(link, calibration, -1)
    say(f"the low end reads {low:.0f} counts")
    low_angle = angle("low", low)
    high, seconds, share = _run_to_end(link, calibration, 1)
    say(f"the high end reads {high:.0f} counts, {seconds:.1f} s later")
    high_angle = angle("high", high)
    full = link.identity.full
    if high - low < NARROW * full:
        raise InputError(
            f"the joint stands at {low:.0f} and at {high:.0f} of {full} counts: that is no way between two ends; is it "
            "blocked, or does the motor need more voltage?"
        )
    go_to_middle(link, calibration, low, high, seconds)
    return Ends(low, high, low_angle, high_angle, seconds, share)


def go_to_middle(link: Link, calibration: Calibration, low: float, high: float, seconds: float) -> None:
    """Bring the joint near the middle of its way, which takes `seconds` from end to end."""
    for _ in range(3):
        place = float(read_sensors(link).mean[calibration.channel])
        off = (place - 0.5 * (low + high)) / (high - low)
        if abs(off) < 0.1:
            return
        way = -1 if off > 0 else 1
        n = max(round(abs(off) * seconds / TS), 5)
        levels = np.full(n + 5, way * round(_share(calibration, way) * wire.FULL))
        levels[n:] = 0
        _move(link, _open_setup(link, calibration), levels)


def _share(calibration: Calibration, way: int) -> float:
    moves = calibration.moves_up if way > 0 else calibration.moves_down
    return min(moves + EXTRA, calibration.largest / calibration.supply)


def _open_setup(link: Link, calibration: Calibration) -> wire.Setup:
    return calibration.raw_setup(link.identity.full, 1.0, STALL, STALL_MOTION)


def _run_to_end(link: Link, calibration: Calibration, way: int) -> tuple[float, float, float]:
    """Reading [counts] where the joint stands in the end, the time [s] until there, and the share of the supply."""
    share = _share(calibration, way)
    levels = np.full(round(LONGEST / TS), way * round(share * wire.FULL))
    recording = _move(link, _open_setup(link, calibration), levels)
    if recording.fault != wire.STALL:
        what = recording.reason or f"it still moves after {LONGEST:g} s"
        raise InputError(f"the run to the {'high' if way > 0 else 'low'} end found none: {what}")
    return float(read_sensors(link).mean[calibration.channel]), max(recording.duration - STALL, TS), share


def zero(calibration: Calibration, ends: Ends) -> Calibration:
    """The calibration with the two ends, and limits that follow from them.

    The soft limits lie beyond the ends, at which the joint then rests as at its limit. Raises InputError for one angle
    at both ends.
    """
    low_angle, high_angle = ends.low_angle, ends.high_angle
    if not abs(high_angle - low_angle) > 1e-3:
        raise InputError(f"both ends have the angle {np.rad2deg(low_angle):.3g} deg; give the angle of each")
    slower = DRY * max(calibration.moves_up, calibration.moves_down)
    crossing = ends.seconds * max(ends.share - DRY * calibration.moves_up, 0.02) / max(1.0 - slower, 0.02)
    beyond = SOFT * calibration.motion
    return calibration.model_copy(
        update={
            "low_counts": round(ends.low, 2),
            "high_counts": round(ends.high, 2),
            "low_angle": low_angle,
            "high_angle": high_angle,
            "soft_low": min(low_angle, high_angle) - beyond,
            "soft_high": max(low_angle, high_angle) + beyond,
            "crossing": round(crossing, 3),
            "strike": round(FASTER * abs(high_angle - low_angle) / crossing, 4),
        }
    )

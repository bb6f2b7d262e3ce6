"""What comes back of goals that were played on a servo: samples with their true times, and the log made of them."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.formats import write_table
from twin.log import Log
from twin.parameters import JOINTS
from twin.rig.bus.servo import About, Servo

LATE = 0.1  # of a sample: a reading farther off its time is missing, as `Repair.jitter` of a mapping has it
# What is measured beside the position, and its column.
EXTRA = {"load": "drive_share", "current": "current_A", "voltage": "supply_V", "temperature": "temperature_C"}


@dataclass
class Recording:
    """What came back of goals (n,) [ticks]: `goals` as the servo has them, `positions` (n,) [ticks], nan where none
    came; when each goal was sent and each position read [s], and what else was measured by name (n,).

    `off` [s] is how long after the end of the run the servo confirmed that its torque is off, None if it did not.
    """

    goals: np.ndarray
    positions: np.ndarray
    sent: np.ndarray
    read: np.ndarray
    Ts: float
    more: dict[str, np.ndarray]
    garbled: int = 0
    silent: int = 0
    unconfirmed: int = 0
    other_goals: int = 0
    reason: str = ""
    interrupted: bool = False
    off: float | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def offsets(self) -> tuple[float, float]:
        """Median times after the grid's at which goals were sent and positions read [s]."""
        return tuple(
            float(np.nanmedian(t - self._grid)) if np.isfinite(t).any() else 0.0 for t in (self.sent, self.read)
        )  # type: ignore[return-value]

    @property
    def _grid(self) -> np.ndarray:
        return np.arange(len(self.goals)) * self.Ts

    @property
    def late(self) -> np.ndarray:
        """Numbers of the samples that were read farther off than `LATE`."""
        off = np.abs(self.read - self._grid - self.offsets[1])
        return np.flatnonzero(np.nan_to_num(off) > LATE * self.Ts)

    @property
    def late_goals(self) -> np.ndarray:
        """Numbers of the goals that were sent farther off than `LATE`."""
        off = np.abs(self.sent - self._grid - self.offsets[0])
        return np.flatnonzero(np.nan_to_num(off) > LATE * self.Ts)

    @property
    def jitter(self) -> tuple[float, float]:
        """Standard deviation and largest distance [s] of the readings from their median place."""
        off = self.read - self._grid - self.offsets[1]
        return (float(np.nanstd(off)), float(np.nanmax(np.abs(off)))) if np.isfinite(off).any() else (0.0, 0.0)


def log_of(recording: Recording, servo: Servo, known: About, source: str = "") -> Log:
    """The log of a recording: goals as the servo had them, angles, and what a reader has to know of the servo.

    A sample that did not come, or was read too late, has no angle: it is nan, and its number is in `meta["filled"]`.
    """
    positions, late = recording.positions.copy(), recording.late
    positions[late] = np.nan
    lost, n = np.flatnonzero(np.isnan(positions)), len(positions)
    (spread, largest), (sent, read) = recording.jitter, recording.offsets
    low = recording.more["voltage"]
    rig: dict[str, Any] = {
        **{"bus": servo.bus, "servo": known.model.name, "number": servo.number, "port": servo.port, "baud": servo.baud},
        "garbled_answers": recording.garbled,
        "lost_answers": recording.silent,
        "late_readings": len(late),
        "late_goals": len(recording.late_goals),
        "unconfirmed_goals": recording.unconfirmed,
        "goals_that_did_not_arrive": recording.other_goals,
        "jitter_ms": round(1e3 * spread, 4),
        "largest_jitter_ms": round(1e3 * largest, 4),
        "reading_after_goal_ms": round(1e3 * (read - sent), 4),
        "lowest_supply": float(np.nanmin(low)) if np.isfinite(low).any() else None,
        "torque_off_after_ms": None if recording.off is None else round(1e3 * recording.off, 3),
        "ended_early": recording.reason or None,
    }
    notes = [*known.notes()]
    if len(lost):
        notes.append(f"{len(lost)} of {n} samples were lost or late: they are marked as missing")
    for count, sentence in (
        (rig["late_readings"], "{} of {} readings came late"),
        (rig["late_goals"], "{} of {} goals were sent late; the model takes them as sent in time"),
        (recording.unconfirmed, "{} of {} goals are not confirmed"),
        (recording.other_goals, "{} of {} goals did not arrive: the log has those that the servo had"),
    ):
        notes += [sentence.format(count, n)] if count else []
    notes += [f"the run ended early: {recording.reason}"] if recording.reason else []
    notes += ["the servo did not confirm that its torque is off"] if recording.off is None else []
    meta: dict[str, Any] = {
        "source": "rig",
        "excitation": source,
        "mode": "servo",
        "u_unit": "rad",
        "rig": rig,
        "notes": notes,
    }
    meta |= {"servo": {**known.loop, "registers": dict(known.registers)}}
    meta |= {"filled": lost.tolist()} if len(lost) else {}
    joint = servo.joint if servo.joint in JOINTS else ""
    return Log(servo.angle(recording.goals), servo.angle(positions), recording.Ts, None, joint, meta)


def save(log: Log, recording: Recording, path: str | Path) -> Path:
    """Write the log with the true times of each sample and what else was measured, in columns of their own."""
    columns: dict[str, np.ndarray] = {"time_s": np.round(log.t, 9), "reference_rad": log.u, "angle_rad": log.y}
    columns |= {"sent_after_ms": 1e3 * (recording.sent - log.t), "read_after_ms": 1e3 * (recording.read - log.t)}
    columns |= {EXTRA[name]: values for name, values in recording.more.items() if np.isfinite(values).any()}
    return write_table(path, columns, json.dumps({**log.meta, "joint": log.joint, "Ts": log.Ts}))

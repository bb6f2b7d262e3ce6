"""Wraps: an angle that a sensor shows within one turn jumps by a turn; the jumps are found and undone."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.data.record import IOData

TURNS = (360.0, 2.0 * math.pi, 1.0, 4096.0, 16384.0, 1024.0, 65536.0)  # degrees, radians, turns, counts
DEGREES = ("deg", "°", "degree", "degrees")
_LARGE, _SMALL = 0.7, 0.3  # of a turn: a jump at a wrap, and a motion between two samples
_OVER = 1e-3  # of a turn by which a record may exceed one


@dataclass(frozen=True)
class Wraps:
    """A record without its wraps; `turn` is the length of a turn, 0 where there were none, `count` how many."""

    data: IOData
    turn: float
    count: int
    sentence: str


def turn_of(data: IOData) -> float:
    """A turn in the unit of the output: 360 in degrees, 2 pi in another unit.

    Of an output without a unit it is a guess: 4096 counts, as bus servos have (data sheets of the Feetech STS3215 and
    the Dynamixel X series), for whole numbers that leave 0 to 360, and 360 for others beyond four turns of radians.
    """
    if data.y_unit:
        return 360.0 if data.y_unit in DEGREES else 2.0 * math.pi
    y = data.y[:, 0]
    if np.all(y == np.rint(y)) and (y.min() < -360.0 or y.max() > 360.0):
        return 4096.0
    return 360.0 if np.ptp(y) > 8.0 * math.pi else 2.0 * math.pi


@checked(deferred=("turn",))
def unwrapped(data: IOData, turn: float | None = None) -> Wraps:
    """The record with the wraps of every output at a turn undone, per experiment; the first angle is kept.

    A jump is a wrap where the output stays within one turn, jumps by more than 0.7 turns and moves by less than 0.3
    turns between all other samples, and most jumps lie in a motion the other way. turn [unit of y]: by default 360,
    2 pi, 1 or an encoder's counts, whichever the jumps show. Raises InputError for a turn that is not above zero.
    """
    if turn is not None and not 0.0 < turn < math.inf:
        raise InputError(f"a turn is {turn}; give its length in the unit of the output, such as 360 or 6.283")
    candidates = TURNS if turn is None else (float(turn),)
    columns, counts, turn_found = [], 0, 0.0
    for j in range(data.y.shape[1]):
        parts = [e.y[:, j] for e in data.experiments]
        period = next((t for t in candidates if _wraps(parts, t)), 0.0)
        if period:
            turn_found = period
            counts += sum(int(np.sum(np.abs(np.diff(part)) > _LARGE * period)) for part in parts)
            parts = [np.unwrap(part, period=period) for part in parts]
        columns.append(np.concatenate(parts))
    if not counts:
        return Wraps(data, 0.0, 0, "no output jumps by a turn")
    ends = "wrap" if counts == 1 else "wraps"
    sentence = f"{counts} {ends} of the output at {turn_found:.6g} undone: its angle now counts on over turns"
    return Wraps(replace(data, y=np.column_stack(columns)), turn_found, counts, sentence)


def _wraps(parts: list[np.ndarray], turn: float) -> bool:
    """Whether these pieces of one output wrap at a turn."""
    y = np.concatenate(parts)
    if not np.all(np.isfinite(y)) or np.ptp(y) > turn * (1.0 + _OVER):
        return False
    jumps = against_motion = 0
    for part in parts:
        steps = np.diff(part)
        large = np.flatnonzero(np.abs(steps) > _SMALL * turn)
        if np.any(np.abs(steps[large]) < _LARGE * turn):
            return False
        inner = large[(large > 0) & (large < len(steps) - 1)]
        jumps += len(inner)
        # Before and after it the angle moves against the jump: what stands there jumps by itself.
        against_motion += int(np.sum((steps[inner - 1] * steps[inner] < 0.0) & (steps[inner + 1] * steps[inner] < 0.0)))
    return against_motion > 0.5 * jumps

"""An output that jumps as it was logged: angles and counters that wrap, and a number that stands for none."""

import math

import numpy as np

from sysid.data.record import IOData
from sysid.data.wraps import unwrapped
from sysid.diagnosis.finding import Advice, channel

TOPIC = "wraps"
WORDS = (8, 16, 24, 32)  # bits of counters, which begin again at 0
ENCODERS = (1000.0, 1024.0, 2000.0, 2048.0, 3600.0, 4000.0, 4096.0, 8192.0, 16384.0)  # counts of a turn
NO_VALUE = "as a number that stands for none"
MAP = "MAP.toml"
_FAR = 5.0  # ranges of the other samples that lie between these and a number that stands for none


def wraps(data: IOData, j: int) -> Advice | None:
    """The warning about output j if it jumps by a turn or as a counter that begins again; None if it does not."""
    name = channel(data, "y", j)
    unit, whole = data.y_unit, not np.any(data.y[:, j] % 1.0)
    missing = None if data.missing is None else data.missing[:, [j]]
    if missing is not None and missing.any():
        return None
    angles = {"rad": (2.0 * math.pi,), "deg": (360.0,), "°": (360.0,)}
    turns = angles.get(unit, tuple(2.0**bits for bits in WORDS) + ENCODERS if whole else ())
    for turn in turns:
        y = [e.y[:, j] for e in data.experiments]
        if max(float(np.ptp(part)) for part in y) < 0.7 * turn:
            continue
        parts = [unwrapped(IOData(e.u, e.y[:, j], e.Ts), turn) for e in data.experiments]
        count = sum(part.count for part in parts)
        if not count:
            continue
        times = "once" if count == 1 else f"{count} times"
        bits = next((bits for bits in WORDS if turn == 2.0**bits), 0)
        if bits and unit not in angles:
            said = f"{name} is a counter of {bits} bits that passes 0 {times}, not an output that jumps"
            if all(_is_signed(a, b.data.y[:, 0], turn) for a, b in zip(y, parts, strict=True)):
                todo = f"write the mapping, set signed = {bits} in its [[output]], and give it with --map"
                return Advice(TOPIC, said, count, todo, "warning", command=("info", "--write-map", MAP))
        else:
            said = f"{name} jumps {times} by a turn of {turn:.4g} {unit or 'counts'}, as a sensor within one turn does"
        todo = "log the angle over turns, or undo the wraps in Python before the fit"
        return Advice(TOPIC, said, count, todo, "warning", call="sysid.data.wraps.unwrapped(data).data")
    return None


def _is_signed(y: np.ndarray, whole: np.ndarray, turn: float) -> bool:
    """Whether a counter as a signed word has no jump: it then is the unwrapped one but for whole turns."""
    offset = np.where(y >= 0.5 * turn, y - turn, y) - whole
    return bool(np.ptp(offset) == 0)


def stands_for_none(y: np.ndarray, found: np.ndarray) -> float | None:
    """The number that all found samples (N,) have, if it lies far outside the others, as -9999 does; else None."""
    odd, sound = np.unique(y[found]), y[~found]
    if len(odd) != 1 or not len(sound) or found.sum() < 2:
        return None
    away = max(float(sound.min()) - odd[0], odd[0] - float(sound.max()))
    return float(odd[0]) if away > _FAR * float(np.ptp(sound)) else None

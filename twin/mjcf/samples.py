"""Readings of a log that are not used: those that are missing, and single ones that no joint makes."""

from collections.abc import Sequence

import numpy as np

from sysid.data.missing import runs
from sysid.data.outliers import hampel, returning
from twin.mjcf.logs import RobotLog

WINDOW = 11  # readings that the finder of outliers needs
NAMED = 5  # stretches of rows in a sentence


def without_spikes(log: RobotLog, model: np.ndarray, noise: np.ndarray) -> RobotLog:
    """The log without readings that jump and come back at once, in themselves and as seen from the `model`'s (N, n).

    A pulse of the error where the joint moves fast is none: the model is late there. `noise` (n,) is that of a reading.
    """
    mask = np.column_stack([_spikes(*columns) for columns in zip(log.y.T, model.T, noise, strict=True)])
    return log.without(mask) if mask.any() else log


def _spikes(y: np.ndarray, model: np.ndarray, noise: float) -> np.ndarray:
    seen, out = np.flatnonzero(np.isfinite(y)), np.zeros(len(y), dtype=bool)
    if len(seen) >= WINDOW and np.all(np.isfinite(model)):
        error = (y - model)[seen]
        mask = returning(error, hampel(error, floor=noise))
        out[seen] = mask & returning(y[seen], mask)
    return out


def sentences(log: RobotLog, names: Sequence[str]) -> list[str]:
    """Which readings of the drives `names` are left out, and where: rows count from 1, below the header."""
    texts = []
    for name, y, odd in zip(names, log.y.T, log.odd.T, strict=True):
        lost = ~np.isfinite(y) & ~odd
        if lost.any():
            texts.append(
                f"{log.name}: {lost.sum()} of {len(y)} readings of {name} are missing and were left out ({rows(lost)})."
            )
        if odd.any():
            texts.append(
                f"{log.name}: {odd.sum()} of {len(y)} readings of {name} leave their neighbours and come back at once, "
                f"which no joint does, and were left out ({rows(odd)})."
            )
    return texts


def rows(mask: np.ndarray) -> str:
    """The rows of a mask (N,) in words."""
    stretches = runs(mask)
    words = [f"{a + 1}" if b == a + 1 else f"{a + 1} to {b}" for a, b in stretches[:NAMED]]
    rest = len(stretches) - NAMED
    word = "row" if mask.sum() == 1 else "rows"
    return f"{word} {', '.join(words)}" + (f" and {rest} more places" if rest > 0 else "")

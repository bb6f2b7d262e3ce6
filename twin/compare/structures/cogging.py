"""A drive whose force varies along the way, as teeth and poles make it: sine sin(turns q) + cosine cos(turns q)."""

from collections.abc import Mapping

import numpy as np

from twin.compare.effects import Knob
from twin.compare.structures._declaration import structure
from twin.plant.added import PUSH, Grid

SINE, COSINE, TURNS = "cogging_sine", "cogging_cosine", "cogging_turns"
_TURNS = np.arange(4.0, 80.0, 0.25)
_MOST = 6  # places at which a search begins
_LEAST = 30  # samples


def drive(grid: Grid, values: Mapping[str, float]) -> np.ndarray:
    table, angle = grid.zeros(), values[TURNS] * grid.angle
    table[PUSH] = values[SINE] * np.sin(angle) + values[COSINE] * np.cos(angle)
    return table


def guess(u: np.ndarray, y: np.ndarray, x: np.ndarray, Ts: float) -> list[dict[str, float]]:
    """Waves in the speed by which the log leaves the twin, where both move the same way, over the angle of the log."""
    over = [angle[3:] - angle[:-3] for angle in (y, x)]  # about the step between the two in the middle
    ways = [np.sign(move) * (np.abs(move) > 0.1 * np.abs(move).max()) for move in over]
    alike = np.flatnonzero((ways[0] == ways[1]) & (ways[0] != 0)) + 1
    if len(alike) < _LEAST:
        return []
    speeds = [(angle[alike + 1] - angle[alike]) / Ts for angle in (y, x)]
    rest, at = speeds[0] - speeds[1], 0.5 * (y[alike + 1] + y[alike])
    per_volt = np.mean(np.abs(speeds[1])) / max(np.mean(np.abs(u[alike])), 1e-9)
    found = []
    for turns in _TURNS:
        waves = np.column_stack([np.sin(turns * at), np.cos(turns * at), np.ones(len(at))])
        values, *_ = np.linalg.lstsq(waves, rest, rcond=None)
        found.append((float(np.mean((rest - waves @ values) ** 2)), turns, *(values[:2] / per_volt)))
    left = np.array([row[0] for row in found])
    inner = np.flatnonzero((left[1:-1] <= left[:-2]) & (left[1:-1] <= left[2:])) + 1
    best = [found[k] for k in inner[np.argsort(left[inner])][:_MOST]]
    return [{TURNS: turns, SINE: sine, COSINE: cosine} for _, turns, sine, cosine in best]


COGGING = structure(
    "cogging",
    "a force that varies along the way (cogging)",
    (
        Knob(SINE, "V", 0.0, -6.0, 6.0, 0.1, words="sine of the force"),
        Knob(COSINE, "V", 0.0, -6.0, 6.0, 0.1, words="cosine of the force"),
        Knob(TURNS, "1", 20.0, 4.0, 80.0, 1.0, words="waves a turn of the joint"),
    ),
    "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
    "slow motion in both directions over the whole stroke",
    drive=drive,
    guess=guess,
)

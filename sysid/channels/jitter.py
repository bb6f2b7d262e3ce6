"""Jitter of time stamps: whether a loop ran at equal steps and its stamps alone are late, or the samples were.

Nothing is resampled that was sampled evenly: rows are the samples of the grid unless the outputs say otherwise.
"""

from collections.abc import Sequence

import numpy as np

CLEAR = 3.0  # log-likelihood ratio: odds of 20 to 1 that samples were taken at their stamps, before y is interpolated


def sampled_at_stamps(t: np.ndarray, index: np.ndarray, step: float, y: Sequence[np.ndarray]) -> bool:
    """Whether outputs `y` (n,) clearly were sampled at their stamps t (n,) [s], not at `index` (n,) times `step` [s].

    A sample that is taken late by e is off the middle of its neighbours by the slope of y times e; one whose stamp
    alone is late is not. Both are compared by their likelihood, with what is left as the variance. Noise of y moves
    both sides alike, and stamps that are hardly off tell nothing.
    """
    late = t - step * index
    ratio = 0.0
    between = np.all([np.diff(index)[:-1] == 1, np.diff(index)[1:] == 1], axis=0)
    for values in y:
        bend = values[1:-1] - 0.5 * (values[:-2] + values[2:])
        slope = (values[2:] - values[:-2]) / (2.0 * step)
        moved = slope * (late[1:-1] - 0.5 * (late[:-2] + late[2:]))
        known = between & np.isfinite(bend)
        rows, stamps = float(np.sum(bend[known] ** 2)), float(np.sum((bend - moved)[known] ** 2))
        least = min(rows, stamps)
        if least > 0.0:
            ratio += 0.5 * int(known.sum()) * (rows - stamps) / least
        elif rows > stamps:
            return True
    return ratio > CLEAR

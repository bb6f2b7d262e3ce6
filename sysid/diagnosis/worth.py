"""What a fit is worth, in one word: the rule of every verb that has a fit."""

from typing import Literal

import numpy as np

from sysid.diagnosis.residuals import CLOSE, POOR, Left, ResidualTests, poor, residual_tests

Word = Literal["good", "usable", "poor"]
_LAGS = 25  # of the residual tests


def worth(percent: float, left: Left | None, sound: bool = True) -> Word:
    """The word for a fit [%], and for what is `left`: None where there is too little to test.

    Poor below `POOR` by more than noise explains (`sysid.diagnosis.residuals.poor`). Good from there on if the input
    explains nothing of what is left, or all of it is within `CLOSE`, and the fit is `sound`: judged by unseen data, and
    nothing is open that its verb knows of. Else usable.
    """
    if poor(percent, left):
        return "poor"
    is_explained = left is None or left.independent or percent >= 100.0 - CLOSE
    return "good" if sound and percent >= POOR and is_explained else "usable"


def left_by_run(u: np.ndarray, y: np.ndarray, run: np.ndarray) -> ResidualTests | None:
    """Tests of what a free run (N,) leaves of y (N,) under u (N,), where y is finite; None where that is too little."""
    kept = np.isfinite(y)
    if kept.sum() <= 2 * _LAGS:
        return None
    return residual_tests((y - run)[kept], np.asarray(u, dtype=float)[kept], _LAGS)

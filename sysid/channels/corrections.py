"""What placing the rows on a grid did to them: as corrections, as a note, and as the clock that was."""

import numpy as np

from sysid.channels.grid import Timing
from sysid.channels.repair import Correction
from sysid.channels.signals import Sampling


def filling_of(timing: Timing, empty: np.ndarray, filled: int) -> Correction:
    """What was filled: samples that were lost between stamps, and cells in the rows `empty` (m,)."""
    grid, stamps = timing.grid, timing.stamps
    lost_rows = stamps.rows[grid.gaps[:, 0] + 1] if stamps is not None else np.zeros(0, dtype=int)
    return Correction(
        {"lost": grid.lost, "empty cells": len(empty), "filled samples": filled},
        f"{grid.lost} lost sample(s) and {len(empty)} empty cell(s) filled: inputs held, outputs by a straight line "
        f"and marked as missing ({filled} samples)",
        np.concatenate([lost_rows, empty]),
    )


def interpolation_of(timing: Timing) -> Correction:
    """What was interpolated: all samples where stamps are not uniform."""
    stamps, grid = timing.stamps, timing.grid
    if stamps is None or grid.index is not None:
        return Correction({}, "")
    steps = np.diff(stamps.t)
    return Correction(
        {"interpolated": grid.N},
        f"the stamps are not uniform (steps of {steps.min():.4g} to {steps.max():.4g} s): resampled every "
        f"{grid.Ts:g} s, outputs by straight lines, held inputs by their mean over each step",
    )


def note_on_loose_stamps(timing: Timing) -> tuple[str, ...]:
    """That rows are taken as they are though stamps are off, and why."""
    grid = timing.grid
    if not grid.loose:
        return ()
    return (
        f"stamps are up to {grid.off:.3g} s ({grid.off / grid.Ts:.0%} of a step) off equal steps of {grid.Ts:g} s, "
        "which never add up, and the outputs do not follow them: the rows are taken as samples at equal steps",
    )


def sampling_of(timing: Timing) -> Sampling:
    """The clock of the file as it was."""
    stamps, grid = timing.stamps, timing.grid
    if stamps is None:
        return Sampling()
    return Sampling(np.diff(stamps.t), grid.median, grid.off, stamps.first, grid.index is None, grid.loose)

"""Which signals of the validation part leave the range that the fit has seen."""

import numpy as np

from sysid.data import IOData

UNVISITED = 0.05  # of the range seen, by which a signal may leave it before a report speaks of it


def unvisited(estimation: IOData, validation: IOData) -> list[str]:
    """A sentence for each signal of the validation part that leaves the range which the fit has seen."""
    notes = []
    for name, unit, seen, new, offset in (
        (estimation.u_name, estimation.u_unit, estimation.u[:, 0], validation.u[:, 0], estimation.u_offset[0]),
        (estimation.y_name, estimation.y_unit, estimation.y[:, 0], validation.y[:, 0], estimation.y_offset[0]),
    ):
        low, high = float(seen.min()), float(seen.max())
        outside = float(np.mean((new < low) | (new > high)))
        if max(low - new.min(), new.max() - high) > UNVISITED * (high - low):
            ranges = [f"{a + offset:.4g} to {b + offset:.4g} {unit}".strip() for a, b in ((low, high), _range(new))]
            notes.append(
                f"{name} was seen from {ranges[0]} and runs from {ranges[1]} in the validation part "
                f"({100 * outside:.1f} % of it outside): what a map says there is extrapolated"
            )
    return notes


def _range(x: np.ndarray) -> tuple[float, float]:
    return float(x.min()), float(x.max())

"""Which signals of the validation part leave the range that the fit has seen, and what carries a model there."""

import numpy as np

from sysid.blocks import TravelMap
from sysid.data import IOData
from sysid.fitting import Fit

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


def carried(fit: Fit, estimation: IOData, validation: IOData) -> list[str]:
    """How much of an actuated joint's travel the estimation part has not seen, and what stands for it there."""
    seen, new = estimation.y[:, 0], validation.y[:, 0]
    travel = next((block for block in fit.model.blocks if isinstance(block, TravelMap)), None)
    low, high = map(float, sorted(fit.model.part(fit.theta, travel)[:2])) if travel else _range(np.append(seen, new))
    a, b = float(np.clip(seen.min(), low, high)), float(np.clip(seen.max(), low, high))
    beyond = [f"{f:.1%}".replace("%", " %") for f in ((a - low) / (high - low), (high - b) / (high - low))]
    if max(a - low, high - b) <= UNVISITED * (high - low):
        return []
    outside = 100 * float(np.mean((new < seen.min()) | (new > seen.max())))
    return [
        f"the estimation part has not seen the lowest {beyond[0]} and the highest {beyond[1]} of the travel between "
        f"the ends, where the validation part is in {outside:.1f} % of its samples: the model is carried there by its "
        "physics, a map that rises in a straight line and an end stop whose place no data show"
    ]


def _range(x: np.ndarray) -> tuple[float, float]:
    return float(x.min()), float(x.max())

"""Numbers that no record of a plant has: their squares leave what a computer can add up."""

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData

LARGEST, SMALLEST = 1e151, 1e-151  # the squares of a record of a million samples still add up to a number


def check_magnitudes(data: IOData) -> None:
    """Raises InputError where a channel has values beyond `LARGEST` or varies by less than `SMALLEST`.

    A channel that does not vary at all passes: what that means depends on the caller.
    """
    for kind, signals, seen in (("input", data.u, None), ("output", data.y, data.observed)):
        for k, column in enumerate(signals.T):
            values = column if seen is None else column[seen[:, k]]
            if not len(values):
                continue
            largest, span = float(np.abs(values).max()), float(np.ptp(values))
            name = kind if signals.shape[1] == 1 else f"{kind} {k + 1}"
            if largest > LARGEST:
                raise InputError(
                    f"the {name} has values up to {largest:.3g}; a fit takes values up to {LARGEST:g}: rescale the "
                    "signal to another unit, or remove the samples that are no measurement"
                )
            if 0.0 < span < SMALLEST:
                raise InputError(
                    f"the {name} varies by {span:.3g}; a fit needs at least {SMALLEST:g}: rescale the signal to "
                    "another unit"
                )

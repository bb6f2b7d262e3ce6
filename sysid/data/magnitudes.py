"""Numbers that no record of a plant has: too large or small to add up, and codes that an instrument writes for none."""

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData

LARGEST, SMALLEST = 1e151, 1e-151  # the squares of a record of a million samples still add up to a number
HUGE = 1e16  # beside which a signal of usual size is rounded away when a mean is subtracted
OVERFLOW_CODES = (9.9e37, 9.91e37, 3.4028235e38)  # of SCPI, and of a float32 that is full
CODE_TOLERANCE = 1e-4  # of a code, which may be printed with few digits
USUAL_SIZE = 1e-9  # how small the others are beside what is no measurement
USUAL_SHARE = 0.1  # part of a column that has to be of usual size, so that the rest stands off


def check_magnitudes(data: IOData) -> None:
    """Raises InputError where a channel has values beyond `LARGEST` or varies by less than `SMALLEST`.

    A channel that does not vary at all passes: what that means depends on the caller.
    """
    for kind, signals, observed in (("input", data.u, None), ("output", data.y, data.observed)):
        for k, column in enumerate(signals.T):
            values = column if observed is None else column[observed[:, k]]
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


def overflow_mask(values: np.ndarray) -> np.ndarray:
    """Which values (n,) are a code of an instrument, or lie so far outside all others as no measurement does."""
    if not len(values) or -HUGE < np.nanmin(values, initial=0.0) <= np.nanmax(values, initial=0.0) < HUGE:
        return np.zeros(len(values), dtype=bool)
    size = np.abs(values)
    huge = (size >= HUGE) & np.isfinite(size)
    usual_sizes = size[(size > 0) & (size < HUGE)]
    if len(usual_sizes) >= USUAL_SHARE * len(values) and usual_sizes.max() <= USUAL_SIZE * size[huge].min():
        return huge
    codes = np.any([np.abs(size - code) <= CODE_TOLERANCE * code for code in OVERFLOW_CODES], axis=0)
    return codes if (size < HUGE).any() and codes[huge].all() else np.zeros(len(values), dtype=bool)

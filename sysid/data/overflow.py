"""Numbers that an instrument writes where it has none: 9.9E37 for an overflow, the largest float32."""

import numpy as np

HUGE = 1e16  # beside which a signal of usual size is rounded away when a mean is subtracted
CODES = (9.9e37, 9.91e37, 3.4028235e38)  # of SCPI, and of a float32 that is full
NEAR = 1e-4  # of a code, which may be printed with few digits
APART = 1e-9  # how small the others are beside what is no measurement
OTHERS = 0.1  # part of a column that has to be of usual size, so that the rest stands off


def overflowed(values: np.ndarray) -> np.ndarray:
    """Which values (n,) are a code of an instrument, or lie so far outside all others as no measurement does."""
    if not len(values) or -HUGE < np.nanmin(values, initial=0.0) <= np.nanmax(values, initial=0.0) < HUGE:
        return np.zeros(len(values), dtype=bool)
    size = np.abs(values)
    huge = (size >= HUGE) & np.isfinite(size)
    others = size[(size > 0) & (size < HUGE)]
    if len(others) >= OTHERS * len(values) and others.max() <= APART * size[huge].min():
        return huge
    codes = np.any([np.abs(size - code) <= NEAR * code for code in CODES], axis=0)
    return codes if (size < HUGE).any() and codes[huge].all() else np.zeros(len(values), dtype=bool)

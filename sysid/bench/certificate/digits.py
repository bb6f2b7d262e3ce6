"""Digits on which a value agrees with a certified one."""

from collections.abc import Iterable

import numpy as np

MOST = 11.0  # NIST certifies that many digits; more agreement says nothing


def digits(value: float | None, certified: float) -> float:
    """The logarithmic relative error -log10(|value / certified - 1|), from 0 to `MOST`; 0 for no number.

    The measure of McCullough 1998, The American Statistician 52, 358-366. Of a certified 0 the error itself counts.
    """
    if value is None or not np.isfinite(value):
        return 0.0
    error = abs(value - certified) / (abs(certified) or 1.0)
    return MOST if error == 0.0 else float(np.clip(-np.log10(error), 0.0, MOST))


def fewest(values: Iterable[float], certified: Iterable[float]) -> float:
    """The digits of the worst of several values."""
    return min(digits(value, sure) for value, sure in zip(values, certified, strict=True))

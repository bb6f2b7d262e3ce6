"""Digits on which a value agrees with a certified one."""

from collections.abc import Iterable

import numpy as np

MOST = 11.0  # NIST certifies that many digits; more agreement says nothing


def digits(value: float | None, reference: float) -> float:
    """The logarithmic relative error -log10(|value / reference - 1|), from 0 to `MOST`; 0 for no number.

    The measure of McCullough 1998, The American Statistician 52, 358-366. Of a reference of 0 the error itself counts.
    """
    if value is None or not np.isfinite(value):
        return 0.0
    error = abs(value - reference) / (abs(reference) or 1.0)
    return MOST if error == 0.0 else float(np.clip(-np.log10(error), 0.0, MOST))


def fewest(values: Iterable[float], references: Iterable[float]) -> float:
    """The digits of the worst of several values."""
    return min(digits(value, reference) for value, reference in zip(values, references, strict=True))

"""The direction of a signal: a sign that turns with the signal's, so that a record and its mirror image can be told."""

import numpy as np

_SKEW = 1e-3  # a third moment below this share of the spread's cube may be rounding
_LATE = 1e-6  # the same of the correlation with time


def direction(x: np.ndarray) -> float:
    """1.0 or -1.0 of a signal x (N,), and the other one of -x; 1.0 of a constant.

    The sign of the third central moment; of a symmetric signal that of its correlation with time, and where there is
    none either, that of the first sample that is clearly away from the mean. Nothing but the sign of x changes what
    this is: no gain, and no offset but for rounding.
    """
    largest = float(np.abs(x).max(initial=0.0))
    x = x / largest if largest > 0.0 else x
    z = x - np.mean(x) if len(x) else x
    size = float(np.sqrt(np.mean(z * z))) if len(x) else 0.0
    if not size > 0.0:
        return 1.0
    skew = float(np.mean(z * z * z)) / size**3
    if abs(skew) > _SKEW:
        return float(np.sign(skew))
    ramp = np.arange(len(z)) - 0.5 * (len(z) - 1.0)
    late = float(z @ ramp) / (size * len(z) * float(np.std(ramp)))
    if abs(late) > _LATE:
        return float(np.sign(late))
    return float(np.sign(z[np.argmax(np.abs(z) > 0.5 * size)]))

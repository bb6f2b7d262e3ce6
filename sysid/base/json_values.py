"""Values for JSON, for the summaries of fits and of the twin."""

from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """The same without NumPy types and without numbers that JSON does not know: these become None.

    Arrays and tuples become lists, a complex number becomes [re, im].
    """
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, (complex, np.complexfloating)):
        return [plain(float(value.real)), plain(float(value.imag))]
    return int(value) if isinstance(value, np.integer) else value

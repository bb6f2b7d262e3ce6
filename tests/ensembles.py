"""A small ensemble, and whether two logs are the same, for tests of several files."""

from pathlib import Path

import numpy as np

from twin import Ensemble, Experiment
from twin.log import Log


def same(a: Log, b: Log) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in ("u", "y", "y_true"))


def ensemble(folder: Path, n: int = 4, **changes) -> Ensemble:
    settings = {"experiment": Experiment("thigh", "aprbs", 1.0), "seeds": range(n), "draws": None, "part": 2}
    return Ensemble(**(settings | {"folder": folder} | changes))

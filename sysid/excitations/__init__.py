"""Excitation signals: one file, one class, one line in `TABLE`.

Each is a frozen dataclass with an `amplitude` and a `generate(N, Ts, rng)` that returns zero-order-hold levels u (N,).
"""

from typing import Protocol

import numpy as np

from sysid.errors import unknown
from sysid.excitations.aprbs import Aprbs
from sysid.excitations.sweep import Sweep


class Excitation(Protocol):
    """What every excitation offers."""

    amplitude: float

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) in the unit of `amplitude`, each held for Ts [s]."""
        ...


TABLE: dict[str, type] = {"aprbs": Aprbs, "sweep": Sweep}


def excitation(name: str, **options: float) -> Excitation:
    """The excitation called `name`; raises InputError for a name that is not in `TABLE`."""
    if name not in TABLE:
        raise unknown("excitation", name, TABLE)
    return TABLE[name](**options)


__all__ = ["TABLE", "Aprbs", "Excitation", "Sweep", "excitation"]

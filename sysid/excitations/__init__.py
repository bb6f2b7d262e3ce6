"""Excitation signals: one file, one class, one line in `TABLE`.

Each is a frozen dataclass of plain numbers and names, with an `amplitude`, an `offset`, the `band` that holds its power
and a `generate(N, Ts, rng)` that returns zero-order-hold levels u (N,) within `amplitude` of `offset`.
"""

from typing import Protocol

import numpy as np

from sysid.base.errors import unknown
from sysid.excitations.aprbs import Aprbs
from sysid.excitations.chirp import Chirp
from sysid.excitations.multisine import Multisine
from sysid.excitations.prbs import Prbs
from sysid.excitations.staircase import Staircase
from sysid.excitations.steps import Steps
from sysid.excitations.sweep import Sweep


class Excitation(Protocol):
    """What every excitation offers."""

    amplitude: float
    offset: float

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies [Hz] between which at least 90 % of the power of u - offset lies."""
        ...

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) in the unit of `amplitude`, each held for Ts [s]; |u - offset| <= amplitude.

        Raises InputError where a record of N samples of Ts cannot carry the signal.
        """
        ...


TABLE: dict[str, type] = {
    "aprbs": Aprbs,
    "chirp": Chirp,
    "multisine": Multisine,
    "prbs": Prbs,
    "staircase": Staircase,
    "steps": Steps,
    "sweep": Sweep,
}


def excitation(name: str, **options: float | str) -> Excitation:
    """The excitation called `name`; raises InputError for a name that is not in `TABLE`."""
    if name not in TABLE:
        raise unknown("excitation", name, TABLE)
    return TABLE[name](**options)


__all__ = [
    "TABLE",
    "Aprbs",
    "Chirp",
    "Excitation",
    "Multisine",
    "Prbs",
    "Staircase",
    "Steps",
    "Sweep",
    "excitation",
]

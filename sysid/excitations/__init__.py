"""Excitation signals: one file, one class, one line in `TABLE`.

Each is a frozen dataclass of plain numbers and names, with an `amplitude`, an `offset`, the `band` that holds its
power and a `generate(N, Ts, rng)` that returns zero-order-hold levels u (N,) within `amplitude` of `offset`. The class
also declares how to adapt it to an experiment: see `Excitation`.
"""

from collections.abc import Mapping
from typing import ClassVar, Protocol

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.excitations._settings import PACES, Paces
from sysid.excitations.aprbs import Aprbs
from sysid.excitations.chirp import Chirp
from sysid.excitations.multisine import Multisine
from sysid.excitations.prbs import Prbs
from sysid.excitations.staircase import Staircase
from sysid.excitations.steps import Steps
from sysid.excitations.sweep import Sweep


class Excitation(Protocol):
    """The interface of every excitation. Every class declares all of it; there are no defaults.

    `seeded`: whether another seed gives another signal with default settings except amplitude and times. `paces`:
    settings for plants of each of `PACES`, in seconds and Hz; other settings keep their defaults. `travel_more`: times
    that increase the travel of an integrating plant if they grow; empty if there are none. `least_samples`: smallest
    number of samples that the times in `travel_less` can have. `centred`: settings that centre the travel of an
    integrating plant on where it starts, if any are needed.
    """

    seeded: ClassVar[bool]
    paces: ClassVar[Paces]
    travel_more: ClassVar[tuple[str, ...]]
    least_samples: ClassVar[Mapping[str, int]]
    centred: ClassVar[Mapping[str, float]]

    @property
    def amplitude(self) -> float:
        """Largest deviation from `offset`."""
        ...

    @property
    def offset(self) -> float:
        """Mean level of the signal, in the unit of `amplitude`."""
        ...

    @property
    def travel_less(self) -> tuple[str, ...]:
        """Settings that decrease the travel of an integrating plant if they are reduced, in the order to try.

        A reach comes first, because it keeps amplitude and holds; an excitation with a reach also has `dead`. Times
        come last: they are shortened if the joint would stick at a small amplitude.
        """
        ...

    @property
    def band(self) -> tuple[float, float]:
        """Frequency band [Hz] with at least 90 % of the power of u - offset."""
        ...

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) in the unit of `amplitude`, each held for Ts [s]; |u - offset| <= amplitude.

        Raises InputError if a record of N samples of Ts cannot hold the signal.
        """
        ...


TABLE: dict[str, type[Excitation]] = {
    "aprbs": Aprbs,
    "chirp": Chirp,
    "multisine": Multisine,
    "prbs": Prbs,
    "staircase": Staircase,
    "steps": Steps,
    "sweep": Sweep,
}


@checked(deferred=("options",))
def excitation(name: str, **options: float | str) -> Excitation:
    """The excitation called `name`; raises InputError for a name that is not in `TABLE`."""
    if name not in TABLE:
        raise unknown("excitation", name, TABLE)
    return TABLE[name](**options)


__all__ = [
    "PACES",
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

"""Excitation signals: one file, one class, one line in `TABLE`.

Each is a frozen dataclass of plain numbers and names, with an `amplitude`, an `offset`, the `band` that holds its power
and a `generate(N, Ts, rng)` that returns zero-order-hold levels u (N,) within `amplitude` of `offset`. What a twin or a
rig needs to shape an experiment by it stands in the class too: see `Excitation`.
"""

from collections.abc import Mapping
from typing import ClassVar, Protocol

import numpy as np

from sysid.base.errors import unknown
from sysid.base.levels import PACES, Paces
from sysid.excitations.aprbs import Aprbs
from sysid.excitations.chirp import Chirp
from sysid.excitations.multisine import Multisine
from sysid.excitations.prbs import Prbs
from sysid.excitations.staircase import Staircase
from sysid.excitations.steps import Steps
from sysid.excitations.sweep import Sweep


class Excitation(Protocol):
    """What every excitation offers. Every class declares all of it itself: nothing is assumed where it says nothing.

    `seeded`: whether another seed draws another signal, all settings but amplitude and times as they are by default.
    `paces`: settings for plants of each of `PACES`, in seconds and Hz; what they leave out stays as it is by default.
    `travel_more`: times whose stretching lets an integrating plant travel further; empty where none does.
    `least_samples`: of the times in `travel_less`, how many samples the shortest that can be generated has.
    `centred`: settings that centre the travel of an integrating plant on where it starts, if any are needed.
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
        """Level about which the signal swings, in the unit of `amplitude`."""
        ...

    @property
    def travel_less(self) -> tuple[str, ...]:
        """Settings whose reduction lets an integrating plant travel less, in the order in which to try them.

        A reach reorders levels and keeps amplitude and holds, so it comes first where there is one; where it stands the
        excitation has a `dead` too. Times come last: they are shortened where a small amplitude would stick.
        """
        ...

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies [Hz] between which at least 90 % of the power of u - offset lies."""
        ...

    def generate(self, N: int, Ts: float, rng: np.random.Generator) -> np.ndarray:
        """Levels u (N,) in the unit of `amplitude`, each held for Ts [s]; |u - offset| <= amplitude.

        Raises InputError where a record of N samples of Ts cannot carry the signal.
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

"""Signals: a uniform record with names and units, and how it was made from a file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.channels.mapping import ROLES, ChannelMap
from sysid.data.record import IOData


@dataclass(frozen=True)
class Signal:
    """Values (N,) of one channel in `unit` (SI where the file's unit is known); `missing` (N,) marks filled samples."""

    name: str
    column: str
    unit: str
    values: np.ndarray
    missing: np.ndarray


@dataclass(frozen=True)
class Sampling:
    """The clock of a file: its steps (n - 1,) [s] as they were, their median and largest distance from the grid [s].

    `start` [s] is the first stamp in the file's clock. Without a clock all are empty, and `Ts` was given.
    """

    steps: np.ndarray = field(default_factory=lambda: np.zeros(0))
    median: float = float("nan")
    off: float = 0.0
    start: float = 0.0
    interpolated: bool = False


@dataclass(frozen=True)
class Signals:
    """A record of N samples every Ts [s] by role, read from the file at `path` as `mapping` says.

    `notes` are sentences about what was assumed and repaired, `counts` the numbers of repairs by kind.
    """

    path: Path
    mapping: ChannelMap
    Ts: float
    input: tuple[Signal, ...]
    output: tuple[Signal, ...]
    other: tuple[Signal, ...] = ()
    notes: tuple[str, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    sampling: Sampling = Sampling()

    @property
    def N(self) -> int:
        """Number of samples."""
        return len(self.all[0].values)

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s], from 0."""
        return np.arange(self.N) * self.Ts

    @property
    def all(self) -> tuple[Signal, ...]:
        """The signals of every role."""
        return tuple(signal for role in ROLES for signal in getattr(self, role))

    @property
    def missing(self) -> np.ndarray:
        """Samples (N,) of which at least one signal was filled."""
        return np.any([signal.missing for signal in self.all], axis=0)

    @checked
    def named(self, name: str) -> Signal:
        """The signal of a name or a column; raises InputError for another."""
        for signal in self.all:
            if name in (signal.name, signal.column):
                return signal
        raise InputError(f"{self.path}: no signal is called {name!r}; choose one of {[s.name for s in self.all]}")

    def io(self) -> IOData:
        """Inputs and outputs, ready to identify; outputs that were filled are marked as missing."""
        u, y = self.input, self.output
        if not (u and y):
            role = "output" if u else "input"
            raise InputError(f"{self.path}: the mapping has no {role}; add a table [[{role}]] with the column")
        missing = np.column_stack([signal.missing for signal in y])
        return IOData(
            np.column_stack([signal.values for signal in u]),
            np.column_stack([signal.values for signal in y]),
            self.Ts,
            *(together([s.name for s in u]) or "u", together([s.name for s in y]) or "y"),
            *(together([s.unit for s in u]), together([s.unit for s in y])),
            missing=missing if missing.any() else None,
        )

    def as_dict(self) -> dict[str, Any]:
        """File, mapping, units, notes and counts for a summary."""
        return {
            "file": str(self.path),
            "mapping": self.mapping.model_dump(exclude_defaults=True),
            "units": {signal.column: signal.unit for signal in self.all},
            "Ts": self.Ts,
            "samples": self.N,
            "notes": list(self.notes),
            "repairs": dict(self.counts),
        }


def together(texts: list[str]) -> str:
    """The text of several channels if it is one, else nothing."""
    return texts[0] if len(set(texts)) == 1 else ""

"""Signals: a uniform record with names and units, how it was made from a file, and at another sampling time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.limits import SAMPLES
from sysid.base.quantities import Units, display_quantity
from sysid.channels.mapping import ROLES, ChannelMap
from sysid.channels.switches import NO_SWITCH
from sysid.data.missing import runs
from sysid.data.record import IOData
from sysid.data.resampling import mean_of_held, resample

_SHORTEST_RUN = 20  # samples: a shorter experiment tells its initial state and little else
FINER = 1000  # times as many samples as stamps, at most: what is made between them tells nothing


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

    `start` [s] is the first stamp in the file's clock. `loose`: stamps are further off than they may be, and rows are
    samples all the same. Without a clock all are empty, and `Ts` was given.
    """

    steps: np.ndarray = field(default_factory=lambda: np.zeros(0))
    median: float = float("nan")
    off: float = 0.0
    start: float = 0.0
    interpolated: bool = False
    loose: bool = False


@dataclass(frozen=True)
class Signals:
    """A record of N samples every Ts [s] by role, read from the file at `path` as `mapping` says.

    `notes` are sentences about what was assumed and repaired, `counts` the numbers of repairs by kind. `lengths` are
    the samples of each experiment of a file that holds several.
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
    lengths: tuple[int, ...] = ()

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
        """Inputs and outputs, ready to identify; outputs that were filled are marked as missing.

        Each stretch of `drive` is an experiment. Raises InputError where the mapping lacks a role.
        """
        u, y = self.input, self.output
        if not (u and y):
            role = "output" if u else "input"
            raise InputError(f"{self.path}: the mapping has no {role}; add a table [[{role}]] with the column")
        missing = np.column_stack([signal.missing for signal in y])
        data = IOData(
            np.column_stack([signal.values for signal in u]),
            np.column_stack([signal.values for signal in y]),
            self.Ts,
            *(common_text([s.name for s in u]) or "u", common_text([s.name for s in y]) or "y"),
            *(common_unit([s.unit for s in u]), common_unit([s.unit for s in y])),
            missing=missing if missing.any() else None,
            lengths=self.lengths,
        )
        if not self.mapping.range.drive:
            return data
        stretches = self.driven
        if not stretches:
            name = self.mapping.range.drive
            raise InputError(
                f"{self.path}: column {name!r} is never on for {_SHORTEST_RUN} samples in a row, so nothing is left; "
                f"give a longer part; {NO_SWITCH}"
            )
        return IOData.merge(*(data.select(*stretch) for stretch in stretches))

    def _driven(self) -> list[tuple[int, int]]:
        """Stretches (start, stop) of samples in which the drive is on."""
        switch = next(s for s in self.other if s.column == self.mapping.range.drive)
        on = switch.values > 0.5 * switch.values.max()  # between samples and behind a filter neither 0 nor 1
        ends = np.cumsum(self.lengths or (self.N,)).tolist()
        borders = zip([0, *ends[:-1]], ends, strict=True)
        return [(a + start, a + stop) for a, b in borders for start, stop in runs(on[a:b])]

    @property
    def driven(self) -> list[tuple[int, int]]:
        """Those that are not too short to tell anything."""
        return [(start, stop) for start, stop in self._driven() if stop - start >= _SHORTEST_RUN]

    def drive_notes(self) -> tuple[str, ...]:
        """How much is left out because the drive is off; nothing of a record that is driven throughout."""
        if not self.mapping.range.drive:
            return ()
        all_, kept = self._driven(), self.driven
        left = self.N - sum(stop - start for start, stop in kept)
        short = f" and {len(all_) - len(kept)} shorter than {_SHORTEST_RUN} samples" if len(kept) < len(all_) else ""
        stretches = "1 stretch" if len(kept) == 1 else f"{len(kept)} stretches"
        return (f"the drive is on in {stretches}{short}: {left} of {self.N} samples are left out",)

    def switch_notes(self) -> tuple[str, ...]:
        """Where a held input, one that mostly keeps its value, is another behind a lost sample than before it."""
        notes = []
        for signal in self.input:
            x = signal.values
            gaps = [(a, b) for a, b in runs(signal.missing) if a > 0 and b < len(x)]
            changed = [a for a, b in gaps if x[b] != x[a - 1]]
            if changed and not np.median(np.abs(np.diff(x))):
                notes.append(
                    f"in {len(changed)} of {len(gaps)} gaps, the first at {changed[0] * self.Ts:g} s, {signal.name!r} "
                    "switched: when is not known, and it is held to the end of the gap, where it may have switched "
                    "before; --missing split makes an experiment of each stretch between gaps"
                )
        return tuple(notes)

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


def common_text(texts: list[str]) -> str:
    """The text of several channels if it is one, else nothing."""
    return texts[0] if len(set(texts)) == 1 else ""


def common_unit(units: list[str]) -> str:
    """The unit of several channels if it is one, else nothing, which knows that of each."""
    shown = {(unit, display_quantity("", unit).unit) for unit in units}
    return units[0] if len(shown) == 1 else Units("", units)


def most_samples(stamps: int) -> int:
    """As many samples as are made of so many stamps at most."""
    return max(min(SAMPLES, FINER * stamps), stamps)


def check_size(path: Path, N: float, stamps: int, Ts: float) -> None:
    """Raises InputError, before the memory is taken, for N samples every `Ts` [s] made of far fewer `stamps`."""
    if most_samples(stamps) < N:
        raise InputError(
            f"{path}: {stamps:,} stamps would become {N:,.0f} samples, one every {Ts:g} s, and at most "
            f"{most_samples(stamps):,} are "
            "made of them; give a longer Ts in [clock] of the mapping, or keep a part without the gap with --range"
        )


def resample_signals(record: Signals, Ts: float | None) -> Signals:
    """The record at the sampling time of the mapping: through a filter if it is longer."""
    if Ts is None or abs(Ts - record.Ts) <= 1e-9 * Ts:
        return record if Ts is None else replace(record, Ts=Ts)
    factor = max(1, round(Ts / record.Ts))
    fine = Ts / factor
    if abs(fine - record.Ts) > 1e-9 * fine:
        record = _interpolate(record, fine)
    return _decimate(record, Ts) if factor > 1 else record


def _interpolate(record: Signals, Ts: float) -> Signals:
    """The record on another grid: held signals by their mean over each step, others by straight lines."""
    check_size(record.path, record.N * record.Ts / Ts, record.N, Ts)
    N = int((record.N - 1) * record.Ts / Ts * (1.0 + 1e-12) + 1e-6) + 1
    t = np.arange(N) * Ts
    left = np.minimum((t / record.Ts * (1.0 + 1e-12) + 1e-6).astype(int), record.N - 1)
    right = np.minimum(left + 1, record.N - 1)

    def interpolate(signal: Signal, held: bool) -> Signal:
        lines = np.interp(t, record.t, signal.values)
        values = mean_of_held(record.t, signal.values, t, t + Ts) if held else lines
        missing = signal.missing[left] if held else signal.missing[left] | signal.missing[right]
        return replace(signal, values=values, missing=missing)

    held = {channel.column: channel.is_held(role) for role, channel, _ in record.mapping.channels()}
    u, y, other = (tuple(interpolate(s, held[s.column]) for s in getattr(record, role)) for role in ROLES)
    note = (
        f"resampled from {record.Ts:g} to {Ts:g} s, held inputs by their mean over each step, others by straight lines"
    )
    return replace(record, Ts=Ts, notes=(*record.notes, note), input=u, output=y, other=other)


def _decimate(record: Signals, Ts: float) -> Signals:
    """The record at a longer sampling time that is a whole number of steps, without aliasing.

    Inputs become the mean over each new step, other signals pass a zero-phase filter (`sysid.data.resampling`).
    """
    held, lines = record.input, (*record.output, *record.other)
    resampling = resample(
        IOData(
            np.column_stack([s.values for s in held]) if held else np.zeros(record.N),
            np.column_stack([s.values for s in lines]) if lines else np.zeros(record.N),
            record.Ts,
            missing=np.column_stack([s.missing for s in lines]) if lines else None,
        ),
        Ts,
        input="held",
    )
    data, factor = resampling.data, resampling.down

    def any_missing(signal: Signal) -> np.ndarray:
        parts = np.zeros(data.N * factor, dtype=bool)
        parts[: record.N] = signal.missing
        return np.any(parts.reshape(data.N, factor), axis=1, keepdims=False)

    missing = np.zeros((data.N, len(lines)), dtype=bool) if data.missing is None else data.missing
    u = [replace(s, values=data.u[:, k], missing=any_missing(s)) for k, s in enumerate(held)]
    y = [replace(s, values=data.y[:, k], missing=missing[:, k]) for k, s in enumerate(lines)]
    return replace(
        record,
        Ts=data.Ts,
        input=tuple(u),
        output=tuple(y[: len(record.output)]),
        other=tuple(y[len(record.output) :]),
        notes=(*record.notes, resampling.sentence),
    )

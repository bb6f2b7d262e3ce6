"""A record at the sampling time that its mapping asks for: through a filter where it becomes longer."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.base.limits import SAMPLES
from sysid.channels.mapping import ROLES
from sysid.channels.signals import Signal, Signals
from sysid.data.record import IOData
from sysid.data.resampling import resample

FINER = 1000  # times as many samples as stamps, at most: what is made between them tells nothing


def check_size(path: Path, N: float, stamps: int, Ts: float) -> None:
    """Raises InputError, before the memory is taken, for N samples every `Ts` [s] made of far fewer `stamps`."""
    most = min(SAMPLES, FINER * stamps)
    if max(most, stamps) < N:
        raise InputError(
            f"{path}: {stamps:,} stamps would become {N:,.0f} samples, one every {Ts:g} s, and at most {most:,} are "
            "made of them; give a longer Ts in [clock] of the mapping, or keep a part without the gap with --range"
        )


def at(record: Signals, Ts: float | None) -> Signals:
    """The record at the sampling time of the mapping: through a filter if it is longer."""
    if Ts is None or abs(Ts - record.Ts) <= 1e-9 * Ts:
        return record if Ts is None else replace(record, Ts=Ts)
    down = max(1, round(Ts / record.Ts))
    fine = Ts / down
    if abs(fine - record.Ts) > 1e-9 * fine:
        record = _refined(record, fine)
    return _coarser(record, Ts) if down > 1 else record


def _refined(record: Signals, Ts: float) -> Signals:
    """The record on another grid: inputs held, others by straight lines."""
    check_size(record.path, record.N * record.Ts / Ts, record.N, Ts)
    N = int((record.N - 1) * record.Ts / Ts * (1.0 + 1e-12) + 1e-6) + 1
    at = np.arange(N) * Ts
    before = np.minimum((at / record.Ts * (1.0 + 1e-12) + 1e-6).astype(int), record.N - 1)
    after = np.minimum(before + 1, record.N - 1)

    def moved(signal: Signal, held: bool) -> Signal:
        values = signal.values[before] if held else np.interp(at, record.t, signal.values)
        missing = signal.missing[before] if held else signal.missing[before] | signal.missing[after]
        return replace(signal, values=values, missing=missing)

    held = {
        c.column: c.between == "held" or (c.between == "" and role == "input")
        for role in ROLES
        for c in getattr(record.mapping, role)
    }
    u, y, other = (tuple(moved(s, held[s.column]) for s in getattr(record, role)) for role in ROLES)
    note = f"resampled from {record.Ts:g} to {Ts:g} s, inputs held, outputs by straight lines"
    return replace(record, Ts=Ts, notes=(*record.notes, note), input=u, output=y, other=other)


def _coarser(signals: Signals, Ts: float) -> Signals:
    """The record at a longer sampling time that is a whole number of steps, without aliasing.

    Inputs become the mean over each new step, other signals pass a zero-phase filter (`sysid.data.resampling`).
    """
    held, lines = signals.input, (*signals.output, *signals.other)
    data = IOData(
        np.column_stack([s.values for s in held]) if held else np.zeros(signals.N),
        np.column_stack([s.values for s in lines]) if lines else np.zeros(signals.N),
        signals.Ts,
        missing=np.column_stack([s.missing for s in lines]) if lines else None,
    )
    found = resample(data, Ts, input="held")
    lost = found.data.missing
    down = found.down

    def filled(signal: Signal, n: int) -> np.ndarray:
        parts = np.zeros(n * down, dtype=bool)
        parts[: signals.N] = signal.missing
        return np.any(parts.reshape(n, down), axis=1, keepdims=False)

    n = found.data.N
    u = [replace(s, values=found.data.u[:, k], missing=filled(s, n)) for k, s in enumerate(held)]
    y = [
        replace(s, values=found.data.y[:, k], missing=np.zeros(n, dtype=bool) if lost is None else lost[:, k])
        for k, s in enumerate(lines)
    ]
    return replace(
        signals,
        Ts=found.data.Ts,
        input=tuple(u),
        output=tuple(y[: len(signals.output)]),
        other=tuple(y[len(signals.output) :]),
        notes=(*signals.notes, found.sentence),
    )

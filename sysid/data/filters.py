"""Butterworth filters on a record: the same filter on input and output preserves the dynamics between them."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.base.limits import ORDER
from sysid.data.record import IOData

KINDS = {"low": "lowpass", "high": "highpass", "band": "bandpass", "stop": "bandstop"}
LOWEST = 1e-6  # of half the sampling rate: a lower cutoff lies within the rounding of the filter's own numbers


@dataclass(frozen=True)
class Filtered:
    """The filtered record and a description of the filter."""

    data: IOData
    sentence: str


@checked
def butterworth(
    data: IOData, cutoff: float | tuple[float, float], kind: str = "low", order: int = 4, causal: bool = False
) -> Filtered:
    """Filter u and y alike; `cutoff` [Hz], two for 'band' and 'stop'.

    A zero-phase filter runs forward and backward: no delay, twice the order, and -6 dB at the cutoff. A causal filter
    starts from the steady state of each experiment's first sample. Filtering preserves a linear model but not a static
    map: before a nonlinear fit remove only what the map does not need (drift, hum), not the levels of the input.
    Missing outputs are filtered as straight lines and stay marked.
    """
    from scipy.signal import butter

    if kind not in KINDS:
        raise unknown("filter", kind, KINDS)
    edges = np.atleast_1d(np.asarray(cutoff, dtype=float))
    half = 0.5 / data.Ts
    edge_count = 2 if kind in ("band", "stop") else 1
    lowest = LOWEST * half
    if edges.shape != (edge_count,) or not np.all((edges >= lowest) & (edges < half)) or np.any(np.diff(edges) <= 0):
        raise InputError(
            f"cutoff is {cutoff} Hz for a {kind} filter; give {edge_count} frequency(ies) from {lowest:g} Hz to below "
            f"{half:g} Hz, half the sampling rate, in rising order"
        )
    if not 1 <= order <= ORDER:
        raise InputError(f"order is {order}; give a whole number from 1 to {ORDER:,}")
    sos = butter(order, edges if edge_count == 2 else edges[0], KINDS[kind], fs=1.0 / data.Ts, output="sos")
    parts = [(_run(sos, e.u, causal), _run(sos, e.y, causal)) for e in data.experiments]
    u, y = (np.concatenate([p[i] for p in parts]) for i in (0, 1))
    way = "causal, the same delay on both" if causal else "forward and backward, without delay"
    edges_in_words = " to ".join(f"{f:g}" for f in edges)
    sentence = f"{KINDS[kind]} Butterworth of order {order} at {edges_in_words} Hz on u and y, {way}"
    if data.missing is not None:
        sentence += f"; {int(data.missing.sum())} missing outputs replaced by straight lines"
    return Filtered(replace(data, u=u, y=y), sentence)


def _run(sos: np.ndarray, x: np.ndarray, causal: bool) -> np.ndarray:
    from scipy.signal import sosfilt, sosfilt_zi, sosfiltfilt

    if causal:
        state = sosfilt_zi(sos)[:, :, None] * x[0]
        return np.asarray(sosfilt(sos, x, axis=0, zi=state)[0])
    padding = 3 * (2 * len(sos) + 1)
    if len(x) <= padding:
        raise InputError(f"an experiment of {len(x)} samples is too short for this filter; give more than {padding}")
    return np.asarray(sosfiltfilt(sos, x, axis=0))

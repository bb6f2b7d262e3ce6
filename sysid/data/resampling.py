"""A record at another sampling time: with an anti-alias filter, exact for an input that is held between samples."""

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.base.rates import drift_note, same_rate
from sysid.data.record import IOData

INPUTS = ("filtered", "held")
MOST = 1000  # of the two whole numbers of a ratio, and of the ratio itself
FINE = 16  # straight lines between so many points a sample are 0.5 % off at the highest frequency


@dataclass(frozen=True)
class Resampled:
    """The record at its new rate, `up` samples for every `down` old ones, and a description."""

    data: IOData
    up: int
    down: int
    sentence: str


@checked(deferred=("Ts", "input"))
def resample(data: IOData, Ts: float, input: str = "filtered") -> Resampled:
    """The record sampled every Ts [s], up to 1000 times slower or faster; a Ts of the same rate only renames it.

    y goes through scipy.signal.resample_poly's zero-phase anti-alias filter; where the ratio
    is not one of whole numbers up to 1000, straight lines follow behind it. The input option 'filtered' applies the
    same filter to u. It preserves a linear model between them but smooths the levels of a held input: use it for a
    linear fit. 'held' gives each new sample the mean of u over its time. It is exact for a zero-order hold and keeps
    the levels that a static input map needs; the filter (cutoff at half the new rate) then acts on y alone. At a
    higher rate u is always held. A new output is missing if an old one that it depends on is missing.
    """
    if input not in INPUTS:
        raise unknown("input", input, INPUTS)
    if not (np.isfinite(Ts) and Ts > 0):
        raise InputError(f"Ts is {Ts}; give the new sampling time as a positive number of seconds")
    if not 1.0 / MOST <= data.Ts / Ts <= MOST:
        raise InputError(f"Ts goes from {data.Ts} to {Ts} s; choose a Ts within a factor of {MOST}")
    if same_rate(data.Ts, Ts):
        same = replace(data, Ts=float(Ts))
        return Resampled(same, 1, 1, drift_note(data.Ts, Ts, data.N, "that asked for") or f"the record has Ts {Ts:g} s")
    ratio = Fraction(data.Ts / Ts).limit_denominator(MOST)
    up, down = ratio.numerator, ratio.denominator
    exact = up <= MOST and abs(up / down * Ts / data.Ts - 1.0) <= 1e-9
    step = down / up if exact else Ts / data.Ts
    parts = [_experiment(e, step, (up, down) if exact else None, input) for e in data.experiments]
    u, y, missing = (np.concatenate([p[i] for p in parts]) for i in range(3))
    fresh = replace(data, u=u, y=y, missing=missing, Ts=float(Ts), lengths=tuple(len(p[0]) for p in parts))
    way = "u held" if input == "held" or step <= 1 else "u with the same filter"
    how = f"({up} for {down} samples)" if exact else "(no ratio of whole numbers: straight lines behind the filter)"
    sentence = (
        f"resampled from {data.Ts:g} to {Ts:g} s {how} with a zero-phase anti-alias filter, {way}; "
        f"{data.N} samples became {fresh.N}"
    )
    return Resampled(fresh, up, down, sentence)


def _experiment(
    e: IOData, step: float, ratio: tuple[int, int] | None, input: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u, y and the marks of missing outputs of one experiment, `step` old samples for each new one."""
    n = int(np.ceil(e.N / step * (1.0 - 1e-12)))
    if n < 2:
        raise InputError(f"{e.N} samples become {n} at the new rate; give a shorter Ts")

    def filtered(x: np.ndarray) -> np.ndarray:
        return _poly(x, *ratio) if ratio else _between(x, step, n)

    y = filtered(e.y)
    u = _mean_inputs(e.u, step, n) if input == "held" or step <= 1 else filtered(e.u)
    is_missing = np.zeros(y.shape, dtype=bool)
    if e.missing is not None:
        # The filter's main lobe spans about one sample of the lower rate to either side.
        reach = max(1.0, step)
        for k in range(n):
            centre = k * step
            lo, hi = max(0, int(np.ceil(centre - reach))), int(np.floor(centre + reach)) + 1
            is_missing[k] = e.missing[lo:hi].any(axis=0)
    return u, y, is_missing


def _between(x: np.ndarray, step: float, n: int) -> np.ndarray:
    """x (N, c) every `step` samples, n times: filtered on a grid FINE times as dense, then straight lines."""
    from scipy.signal import firwin, resample_poly

    lowest = max(1.0, step) * FINE
    window = firwin(2 * int(10 * lowest) + 1, 1.0 / lowest, window=("kaiser", 5.0))  # as resample_poly's own
    dense = np.asarray(resample_poly(x, FINE, 1, axis=0, window=window, padtype="line"))
    places = np.minimum(np.arange(n) * step, len(x) - 1)  # the last new sample may lie behind the last old one
    return np.column_stack([np.interp(places * FINE, np.arange(len(dense)), column) for column in dense.T])


def _poly(x: np.ndarray, up: int, down: int) -> np.ndarray:
    from scipy.signal import resample_poly

    # 'line' extends the signal at the level of each end, so that an offset does not ring there.
    return np.asarray(resample_poly(x, up, down, axis=0, padtype="line"))


def _mean_inputs(u: np.ndarray, step: float, n: int) -> np.ndarray:
    """Mean of the held u over each new sample's time (n, nu): the integral of u is the same at both rates."""
    t, edges = np.arange(len(u)), np.minimum(np.arange(n + 1) * step, len(u))
    return np.column_stack([mean_of_held(t, column, edges[:-1], edges[1:]) for column in u.T])


def mean_of_held(t: np.ndarray, values: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """The mean (m,) between `start` and `stop` (m,) of values (n,) that are held from their times t (n,), which rise.

    What drives a plant over a step is this mean. The first value holds before its time and the last one behind it. Of a
    step without width, as at a time so large that a step adds nothing to it, the mean is the value there.
    """
    sums = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(t))])
    first, last = (np.maximum(np.searchsorted(t, places, side="right") - 1, 0) for places in (start, stop))
    area = sums[last] + values[last] * (stop - t[last]) - sums[first] - values[first] * (start - t[first])
    return np.divide(area, stop - start, out=values[first].astype(float), where=stop > start)

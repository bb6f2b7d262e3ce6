"""A record at another sampling time: with an anti-alias filter, exact for an input that is held between samples."""

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.data.record import IOData

INPUTS = ("filtered", "held")
MOST = 1000  # of the two whole numbers of a ratio


@dataclass(frozen=True)
class Resampled:
    """The record at its new rate, `up` samples for every `down` old ones, and a description."""

    data: IOData
    up: int
    down: int
    sentence: str


@checked(deferred=("Ts", "input"))
def resample(data: IOData, Ts: float, input: str = "filtered") -> Resampled:
    """The record sampled every Ts [s]; Ts / data.Ts must be a ratio of whole numbers up to 1000.

    y goes through scipy.signal.resample_poly's zero-phase anti-alias filter. The input option 'filtered' applies the
    same filter to u. It preserves a linear model between them but smooths the levels of a held input: use it for a
    linear fit. 'held' gives each new sample the mean of u over its time. It is exact for a zero-order hold and keeps
    the levels that a static input map needs; the filter (cutoff at half the new rate) then acts on y alone. At a
    higher rate u is always held. A new output is missing if an old one that it depends on is missing.
    """
    if input not in INPUTS:
        raise unknown("input", input, INPUTS)
    if not (np.isfinite(Ts) and Ts > 0):
        raise InputError(f"Ts is {Ts}; give the new sampling time as a positive number of seconds")
    rate_ratio = data.Ts / Ts
    ratio = Fraction(rate_ratio if rate_ratio < 2 * MOST else 0).limit_denominator(MOST)
    if ratio == 0 or abs(float(ratio) * Ts / data.Ts - 1.0) > 1e-9 or ratio.numerator > MOST:
        raise InputError(
            f"Ts goes from {data.Ts} to {Ts} s, not a ratio of whole numbers up to {MOST}; choose a Ts near it that is"
        )
    up, down = ratio.numerator, ratio.denominator
    parts = [_experiment(e, up, down, input) for e in data.experiments]
    u, y, missing = (np.concatenate([p[i] for p in parts]) for i in range(3))
    fresh = replace(data, u=u, y=y, missing=missing, Ts=float(Ts), lengths=tuple(len(p[0]) for p in parts))
    way = "u held" if input == "held" or down <= up else "u with the same filter"
    sentence = (
        f"resampled from {data.Ts:g} to {Ts:g} s ({up} for {down} samples) with a zero-phase anti-alias filter, {way}; "
        f"{data.N} samples became {fresh.N}"
    )
    return Resampled(fresh, up, down, sentence)


def _experiment(e: IOData, up: int, down: int, input: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n = -(-e.N * up // down)
    if n < 2:
        raise InputError(f"{e.N} samples become {n} at the new rate; give a shorter Ts")
    y = _poly(e.y, up, down)
    u = _mean_inputs(e.u, up, down, n) if input == "held" or down <= up else _poly(e.u, up, down)
    is_missing = np.zeros(y.shape, dtype=bool)
    if e.missing is not None:
        # The filter's main lobe spans about one sample of the lower rate to either side.
        reach = max(1.0, down / up)
        for k in range(n):
            centre = k * down / up
            lo, hi = max(0, int(np.ceil(centre - reach))), int(np.floor(centre + reach)) + 1
            is_missing[k] = e.missing[lo:hi].any(axis=0)
    return u, y, is_missing


def _poly(x: np.ndarray, up: int, down: int) -> np.ndarray:
    from scipy.signal import resample_poly

    # 'line' extends the signal at the level of each end, so that an offset does not ring there.
    return np.asarray(resample_poly(x, up, down, axis=0, padtype="line"))


def _mean_inputs(u: np.ndarray, up: int, down: int, n: int) -> np.ndarray:
    """Mean of the held u over each new sample's time (n, nu): the integral of u is the same at both rates."""
    integral = np.concatenate([np.zeros((1, u.shape[1])), np.cumsum(u, axis=0)])
    edges = np.minimum(np.arange(n + 1) * (down / up), len(u))
    areas = np.column_stack([np.interp(edges, np.arange(len(u) + 1), column) for column in integral.T])
    widths = np.diff(edges)
    return np.diff(areas, axis=0) / widths[:, None]

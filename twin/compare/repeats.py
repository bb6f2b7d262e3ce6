"""Two logs under the same input: how well an experiment repeats."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from sysid.base.errors import InputError
from sysid.data.record import IOData
from twin.compare.intervals import LEVEL, sandwich
from twin.compare.regimes import noise_of

_SAME = 1e-3  # of the input's range: inputs that differ by less are the same


@dataclass(frozen=True)
class Repeat:
    """spread [rad]: RMS of the difference of the two logs about its trend; `by_noise`: what noise of both makes of it.

    offset [rad] is the mean of the difference (first log less second), drift [rad/s] its slope over time, each with an
    interval of level `LEVEL` that allows for coloured differences.
    """

    spread: float
    by_noise: float
    offset: tuple[float, float, float]
    drift: tuple[float, float, float]
    samples: int

    @property
    def drifts(self) -> bool:
        """Whether the interval of the drift excludes zero."""
        return not self.drift[1] <= 0.0 <= self.drift[2]


def repeat(one: IOData, two: IOData, label: str) -> Repeat:
    """The difference of two logs over the samples that both have; raises InputError if their inputs differ."""
    if abs(one.Ts - two.Ts) > 1e-9 * one.Ts:
        raise InputError(f"the logs have sampling times of {one.Ts:g} and {two.Ts:g} s; resample one of them")
    n = min(one.N, two.N)
    u, other = one.u[:n, 0], two.u[:n, 0]
    off = np.abs(u - other)
    if off.max() > _SAME * max(float(np.ptp(u)), 1e-12):
        k = int(off.argmax())
        raise InputError(
            f"the inputs differ: {u[k]:g} V and {other[k]:g} V in {label} at {k * one.Ts:g} s; logs are compared under "
            "the same input, so record both with one, or compare each with the twin"
        )
    e = one.y[:n, 0] - two.y[:n, 0]
    t = np.arange(n) * one.Ts
    X = np.column_stack([np.ones(n), t - t.mean()])
    beta, *_ = np.linalg.lstsq(X, e, rcond=None)
    rest = e - X @ beta
    half = float(norm.ppf(0.5 + LEVEL / 2)) * sandwich(X, rest)
    (a, b), (da, db) = beta.tolist(), half.tolist()
    noise = float(np.hypot(noise_of(one.y[:n, 0]), noise_of(two.y[:n, 0])))
    spread = float(np.sqrt(np.mean(rest**2)))
    return Repeat(spread, noise, (a, a - da, a + da), (b, b - db, b + db), n)

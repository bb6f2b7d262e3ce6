"""What a cause leaves of a departure: whether it is noise, and whether parts of the record agree on the cause.

A wrong cause that is moved until it fits leaves errors with a structure, or needs other values in one part of the
record than in another: in another half, direction, level or place. The values of a part are those of a Gauss-Newton
step on its samples alone. Two sets of values are held against one by an F test of the errors, whitened by their
autoregression (Chow, Econometrica 28, 1960).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import f as f_distribution

from sysid.diagnosis.residuals import residual_tests
from sysid.estimation.noise_model import noise_model
from twin.compare.departure import noise_of, speed_of
from twin.compare.search import Search, Trials, differences
from twin.follow import VISIBLE

_CHANCE = 0.01  # of calling a right cause wrong, over all splits
_LAGS = 25
_LEAST = 50  # samples of a part
_BLIND = 1e-6  # of the largest: a direction that a part does not show


@dataclass(frozen=True)
class Remainder:
    """RMS [rad] of what is left beyond noise, whether it is white noise, and `uneven`: the splits whose parts disagree.

    White noise is neither coloured nor louder than that of the log, as an outlier makes it. A split counts where chance
    does not explain the difference and it moves the response by more than `VISIBLE`.
    """

    rms: float
    white: bool
    uneven: tuple[str, ...]

    @property
    def structured(self) -> bool:
        """Whether something is left that is no noise and matters."""
        return self.rms > VISIBLE and not self.white

    @property
    def none(self) -> bool:
        """Whether the cause explains the departure, everywhere alike."""
        return not (self.structured or self.uneven)


def remainder(trials: Trials, search: Search, y: np.ndarray) -> Remainder:
    """What `search` at its end leaves of the log y (N,) [rad] of `trials`."""
    (J,) = differences(trials, [search])
    e, columns = y - J[:, 0], J[:, 1:]
    noise = noise_of(y) ** 2
    left = float(np.sqrt(max(np.mean(e**2) - noise, 0.0)))
    # The variance of the noise comes from second differences, of three readings each, in half of the record.
    loud = f_distribution.sf(np.mean(e**2) / noise, len(e), len(e) / 6.0) < _CHANCE if noise > 0.0 else left > 0.0
    white = residual_tests(e, trials.follower.u, _LAGS).white and not loud
    splits = _splits(J[:, 0], trials.follower.u, trials.follower.log.Ts)
    limit = _CHANCE / len(splits)
    uneven = tuple(name for name, part in splits.items() if _disagree(columns, e, part, limit))
    return Remainder(left, white, uneven)


def _splits(y: np.ndarray, u: np.ndarray, Ts: float) -> Mapping[str, np.ndarray]:
    """Samples (N,) of one part, by what tells it from the other.

    y (N,) is the response and not the log, of which the noise would choose the part: where a joint rests at the median,
    what reads high would stand against what reads low.
    """
    speed, level = speed_of(y, Ts)[0], np.abs(u)
    return {
        "earlier and later": np.arange(len(y)) < len(y) // 2,
        "upward and downward": speed > 0.0,
        "low and high voltages": level < np.median(level),
        "low and high angles": y < np.median(y),
    }


def _disagree(J: np.ndarray, e: np.ndarray, part: np.ndarray, limit: float) -> bool:
    """Whether the values that suit the samples of `part` and those that suit the others differ beyond chance."""
    if min(part.sum(), (~part).sum()) < _LEAST:
        return False
    J = J[:, np.linalg.norm(J, axis=0) > 1e-10 * max(float(np.linalg.norm(J)), 1e-300)]
    J = J / np.linalg.norm(J, axis=0)
    both = np.hstack([np.where(mask[:, None], J, 0.0) for mask in (part, ~part)])
    # The errors' colour is that beside values of each part's own: a difference between the parts is no noise.
    own = _left(both, e)
    white = partial(noise_model(own, both, [len(e)]).white, lengths=[len(e)])
    alike, apart = (float(np.sum(_left(white(X), white(e)) ** 2)) for X in (J, both))
    ranks = [int(np.linalg.matrix_rank(white(X), rtol=_BLIND)) for X in (J, both)]
    more, left = ranks[1] - ranks[0], len(e) - ranks[1]
    visible = float(np.sqrt(np.mean((_left(J, e) - own) ** 2))) > VISIBLE
    return bool(visible and more > 0 and f_distribution.sf((alike - apart) / more / (apart / left), more, left) < limit)


def _left(X: np.ndarray, e: np.ndarray) -> np.ndarray:
    """What least squares on the columns of X (N, n) leaves of e (N,)."""
    return np.asarray(e - X @ np.linalg.lstsq(X, e, rcond=_BLIND)[0])

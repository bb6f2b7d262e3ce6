"""What a cause leaves of a departure: whether it is noise, and whether parts of the record agree on the cause.

A wrong cause that is moved until it fits leaves errors with a structure, or needs other values in one part of the record
than in another: in another half, direction, level or place. The values of a part are those of a Gauss-Newton step on
its samples alone; their difference is held against its covariance, which allows for coloured errors (a Chow test,
Econometrica 28, 1960, with the covariance of Newey and West).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from sysid.diagnosis.residuals import residual_tests
from sysid.estimation.noise_model import long_run_covariance_root, noise_model
from twin.compare.departure import noise_of, speed_of
from twin.compare.search import Search, Trials, differences

VISIBLE = float(np.deg2rad(0.05))  # RMS: smaller differences of a leg matter to nobody
_CHANCE = 0.01  # of calling a right cause wrong, over all splits
_LAGS = 25
_LEAST = 50  # samples of a part
_BLIND = 1e-8  # of the largest: a direction that a part does not show


@dataclass(frozen=True)
class Remainder:
    """RMS [rad] of what is left beyond noise, whether it is white, and `uneven`: the splits whose parts disagree.

    A split counts where chance does not explain the difference and it moves the response by more than `VISIBLE`.
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
    (J,) = differences(trials, [Search(search.name, search.knobs, dict(search.state))])
    e, columns = y - J[:, 0], J[:, 1:]
    left = float(np.sqrt(max(np.mean(e**2) - noise_of(y) ** 2, 0.0)))
    tests = residual_tests(e, trials.follower.u, _LAGS)
    splits = _splits(y, trials.follower.u, trials.follower.log.Ts)
    limit = _CHANCE / len(splits)
    uneven = tuple(name for name, part in splits.items() if _disagree(columns, e, part, limit))
    return Remainder(left, tests.white, uneven)


def _splits(y: np.ndarray, u: np.ndarray, Ts: float) -> Mapping[str, np.ndarray]:
    """Samples (N,) of one part, by what tells it from the other."""
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
    active = np.linalg.norm(J, axis=0) > 1e-10 * max(float(np.linalg.norm(J)), 1e-300)
    J = J[:, active]
    size, noise = np.linalg.norm(J, axis=0), noise_model(e, J, [len(e)])
    change, covariance = np.zeros(J.shape[1]), np.zeros((J.shape[1], J.shape[1]))
    for sign, mask in ((1.0, part), (-1.0, ~part)):
        rows = np.where(mask[:, None], J, 0.0) / size
        inverse = np.linalg.pinv(rows.T @ rows, rcond=_BLIND, hermitian=True) / size[:, None]
        root = inverse @ long_run_covariance_root(e, rows, [len(e)], "auto", noise)[0]
        change += sign * inverse @ (rows.T @ e)
        covariance += root @ root.T
    moves = float(np.sqrt(np.mean((J @ change) ** 2)))
    scaled = covariance * np.outer(size, size)
    inverse = np.linalg.pinv(scaled, rcond=_BLIND, hermitian=True)
    rank = int(np.linalg.matrix_rank(scaled, rtol=_BLIND, hermitian=True))
    distance = float((size * change) @ inverse @ (size * change))
    return bool(moves > VISIBLE and chi2.sf(distance, max(rank, 1)) < limit)

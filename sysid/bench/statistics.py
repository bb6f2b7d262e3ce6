"""Statistics of a results table: intervals of a rate, mean of times, performance profiles, win/tie/loss."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEVEL = 0.95
SHIFT = 1.0  # [s]; times well below it count as equal
RESAMPLES = 10_000


@dataclass(frozen=True)
class Rate:
    """A share k / n with its interval at `LEVEL`; nan and (0, 1) without cases."""

    k: int
    n: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """k / n."""
        return self.k / self.n if self.n else float("nan")


def wilson(k: int, n: int, level: float = LEVEL) -> Rate:
    """The rate k of n with Wilson's score interval (Wilson 1927, J. Am. Stat. Assoc. 22, 209-212)."""
    from scipy.stats import binomtest

    if n == 0:
        return Rate(0, 0, 0.0, 1.0)
    interval = binomtest(int(k), int(n)).proportion_ci(level, method="wilson")
    return Rate(int(k), int(n), float(interval.low), float(interval.high))


def shifted_geometric_mean(values: Sequence[float] | np.ndarray, shift: float = SHIFT) -> float:
    """exp(mean(log(values + shift))) - shift, nan without values.

    It weighs ratios, as a geometric mean does, but values far below `shift` differ little (Achterberg 2007, Constraint
    Integer Programming, section A.3).
    """
    x = np.asarray(values, dtype=float)
    return float(np.exp(np.mean(np.log(x + shift))) - shift) if len(x) else float("nan")


def performance_profile(costs: np.ndarray, taus: np.ndarray) -> np.ndarray:
    """Share (len(taus), solvers) of problems that a solver ends within tau times the least cost of any solver.

    costs (problems, solvers) are positive; nan or infinity is a failure. A problem that all solvers fail stays in the
    count and is solved by none (Dolan and More 2002, Math. Program. 91, 201-213, eq. 2.1).
    """
    cost = np.where(np.isfinite(costs), costs, np.inf)
    best = cost.min(axis=1, keepdims=True, initial=np.inf)
    with np.errstate(invalid="ignore"):  # inf / inf: failed by all
        ratio = np.sort(np.where(np.isfinite(cost), cost / best, np.inf), axis=0)
    return np.stack([np.searchsorted(column, taus, side="right") for column in ratio.T], axis=1) / max(len(cost), 1)


@dataclass(frozen=True)
class Duel:
    """Pairs that one method wins, ties and loses against another; shares of n with bootstrap intervals (low, high)."""

    wins: int
    ties: int
    losses: int
    win: tuple[float, float]
    tie: tuple[float, float]
    loss: tuple[float, float]

    @property
    def n(self) -> int:
        """How many pairs there are."""
        return self.wins + self.ties + self.losses


def duel(mine: np.ndarray, theirs: np.ndarray, margin: float, level: float = LEVEL, seed: int = 0) -> Duel:
    """Win, tie and loss of paired scores (n,), higher is better; a difference within `margin` is a tie.

    The intervals are percentiles of a bootstrap over the pairs (Efron and Tibshirani 1993, chapter 13). Pairs drawn
    with replacement fall into the three classes as a multinomial of n, so the counts are drawn instead of the pairs.
    """
    with np.errstate(invalid="ignore"):
        d = np.where(mine == theirs, 0.0, np.subtract(mine, theirs))  # equal infinities tie
    counts = np.array([(d > margin).sum(), (np.abs(d) <= margin).sum(), (d < -margin).sum()])
    if not counts.sum():
        return Duel(0, 0, 0, (0.0, 1.0), (0.0, 1.0), (0.0, 1.0))
    n = counts.sum()
    shares = np.random.default_rng(seed).multinomial(n, counts / n, size=RESAMPLES) / n
    ends = np.quantile(shares, [(1 - level) / 2, (1 + level) / 2], axis=0)
    win, tie, loss = ((float(low), float(high)) for low, high in ends.T)
    wins, ties, losses = (int(count) for count in counts)
    return Duel(wins, ties, losses, win, tie, loss)


def median_interval(values: np.ndarray, level: float = LEVEL, seed: int = 0) -> tuple[float, float]:
    """Bootstrap percentiles of the median of values (n,); (nan, nan) below two values."""
    from scipy.stats import bootstrap

    if len(values) < 2:
        return float("nan"), float("nan")
    result = bootstrap(
        (values,),
        np.median,
        n_resamples=2000,
        confidence_level=level,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(seed),
        batch=200,
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)

"""Statistics of the benchmark against closed forms, published values and resampling by another library."""

import numpy as np
import pytest
from scipy.stats import binom, bootstrap

from sysid.bench.statistics import duel, median_interval, performance_profile, shifted_geometric_mean, wilson


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),  # Newcombe 1998, Stat. Med. 17, 857-872, table I, method 3
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_gives_published_intervals(k, n, low, high):
    rate = wilson(k, n)
    assert (rate.low, rate.high) == pytest.approx((low, high), abs=5e-5)
    assert rate.value == k / n


def test_a_rate_of_nothing_says_nothing():
    rate = wilson(0, 0)
    assert (rate.low, rate.high) == (0.0, 1.0)
    assert np.isnan(rate.value)


def test_shifted_geometric_mean_by_hand():
    assert shifted_geometric_mean([1.0, 7.0], shift=1.0) == pytest.approx(3.0)  # sqrt(2 * 8) - 1
    assert shifted_geometric_mean([2.0, 8.0], shift=0.0) == pytest.approx(4.0)
    assert shifted_geometric_mean([0.0, 90.0], shift=10.0) == pytest.approx(np.sqrt(1000.0) - 10.0)


def test_performance_profile_by_hand():
    costs = np.array([[1.0, 2.0], [4.0, 1.0], [3.0, np.inf], [np.nan, np.inf]])
    profile = performance_profile(costs, np.array([1.0, 1.9, 2.0, 4.0, 1e9]))
    assert profile[:, 0].tolist() == [0.5, 0.5, 0.5, 0.75, 0.75]
    assert profile[:, 1].tolist() == [0.25, 0.25, 0.5, 0.5, 0.5]


def test_a_difference_within_the_margin_is_a_tie():
    mine = np.array([90.0, 90.0, 90.0, 90.0, -np.inf, -np.inf, 90.0])
    theirs = np.array([89.0, 90.5, 91.0, 90.0, -np.inf, 10.0, -np.inf])
    found = duel(mine, theirs, margin=0.5)
    assert (found.wins, found.ties, found.losses, found.n) == (2, 3, 2, 7)


def test_bootstrap_of_a_win_share_has_the_percentiles_of_a_binomial():
    """The share of wins in pairs drawn with replacement is binomial, so its percentiles are known."""
    d = np.concatenate([np.ones(30), np.zeros(50), -np.ones(20)])
    found = duel(d, np.zeros(100), margin=0.1)
    for count, interval in ((30, found.win), (50, found.tie), (20, found.loss)):
        assert interval == pytest.approx(binom.ppf([0.025, 0.975], 100, count / 100) / 100, abs=0.0101)


def test_bootstrap_agrees_with_resampling_the_pairs_themselves():
    d = np.random.default_rng(4).normal(0.3, 1.0, 60)
    found = duel(d, np.zeros(60), margin=0.2)
    scipys = bootstrap((d > 0.2,), np.mean, n_resamples=5000, method="percentile", rng=np.random.default_rng(1))
    interval = scipys.confidence_interval
    assert found.win == pytest.approx((interval.low, interval.high), abs=1.5 / 60)


def test_intervals_of_a_median_hold_it_as_often_as_they_claim():
    """Of 300 intervals at 95 % for 25 values, 270 at least: 4 standard deviations below 285."""
    rng = np.random.default_rng(7)
    held = 0
    for k in range(300):
        low, high = median_interval(rng.exponential(size=25), seed=k)
        held += low <= np.log(2.0) <= high
    assert 270 <= held <= 299

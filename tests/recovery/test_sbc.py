"""The study of distributions of true values: its band, its transform and its plants."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm, t

from sysid.uncertainty.intervals import Interval

sys.path += [str(Path(__file__).resolve().parents[2] / "scripts" / part) for part in ("", "studies")]
sbc = pytest.importorskip("sbc")


def test_the_band_holds_95_of_100_uniform_samples():
    """Samples of another generator than that of the level."""
    level = sbc.local_level(80)
    rng = np.random.default_rng([1, 80])
    counts = np.array([np.sum(rng.random(80)[:, None] <= sbc.PLACES, axis=0) for _ in range(2000)])
    outside = np.mean(sbc.tails(counts, 80).min(axis=1) < level)
    assert outside == pytest.approx(0.05, abs=0.02)  # three standard deviations of either simulation


@pytest.mark.parametrize(
    ("factor", "shift", "inside"), [(1.0, 0.0, True), (1.4, 0.0, False), (0.7, 0.0, False), (1.0, 0.3, False)]
)
def test_intervals_too_narrow_too_wide_or_off_leave_the_band(factor, shift, inside):
    errors = factor * np.random.default_rng(4).standard_normal(500) + shift
    found = sbc.figures_of(norm.cdf(errors).tolist())
    assert found["inside"] is inside
    assert found["n"] == 500
    expected = [np.mean(np.abs(errors) <= norm.ppf(0.5 + level / 2)) for level in (0.5, 0.9, 0.95, 0.99)]
    assert found["held"] == pytest.approx(expected)
    departure = max(abs(np.mean(norm.cdf(errors) <= place) - place) for place in sbc.PLACES)
    assert found["departure"] == pytest.approx(departure)


def test_the_transform_is_that_of_the_interval():
    class Info:
        dof = 7.0

    half = t.ppf(0.975, 7.0) * 0.2
    own = Interval(1.0, 0.2, 1.0 - half, 1.0 + half)
    assert sbc.transform(Info, own, 1.0 + half, "")[0] == pytest.approx(0.975)
    assert sbc.transform(Info, own, 1.0 - half, "")[0] == pytest.approx(0.025)
    value, why = sbc.transform(Info, Interval(1.0, 0.2, -np.inf, np.inf, "is cancelled"), 1.0, "")
    assert np.isnan(value)
    assert why == "is cancelled"


def test_a_drawn_filter_has_the_deviation_that_the_prior_states():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal(400)
        n = seed % 3 + 1
        theta, y = sbc.draw_filter(n, u, rng)
        assert lfilter([0.0, *theta[:n]], [1.0, *theta[n:]], u) == pytest.approx(y)
        assert y.std() == pytest.approx(1.0)
        sizes = np.abs(np.roots([1.0, *theta[n:]]))
        assert np.exp(-1.0 / 2.0) - 1e-6 <= sizes.min()
        assert sizes.max() <= np.exp(-1.0 / 30.0) + 1e-6


def test_a_case_has_a_number_or_a_reason_for_each_value():
    row = sbc.score(("wiener", 0.0, 3), None)
    assert {*row["pit"], *row["open"]} == {"pole", "gain", "map", "output"}
    assert all(0.0 <= value <= 1.0 for value in row["pit"].values())
    (entry, *_) = sbc.counts([{"case": ("wiener", 0.0, k), **row} for k in range(12)])
    assert (entry["structure"], entry["noise"], entry["kind"], entry["n"] + entry["open"]) == (
        "wiener",
        "white",
        "pole",
        12,
    )

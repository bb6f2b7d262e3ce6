"""Maps with many break points and a prior that the record chooses: against known curves, closed forms and truth."""

import numpy as np
import pytest
from often import FULL
from scipy.signal import lfilter

import sysid
from sysid import IOData, Objective
from sysid.blocks import PiecewiseLinear
from sysid.solver.covariance import effective_count
from sysid.solver.iterate import Linearisation
from sysid.structures import hammerstein, hammerstein_wiener, wiener

FINE = Objective(knots=50)


def through(u):
    """A resonant filter of gain 1."""
    return lfilter([0.0, 0.36], [1.0, -1.2, 0.56], u)


def record(curve, N, deviation, seed, last=None):
    """The record of a Wiener plant with this curve behind its filter, from rest, and y (N,) without noise."""
    rng = np.random.default_rng([N, seed])
    u = np.repeat(rng.uniform(-2.0, 2.0, N), 6)[:N] if last is None else last(rng, N)
    y = curve(through(u))
    return IOData(u, y + deviation * rng.standard_normal(N), 1.0), y


def noise(rng, N):
    """Another kind of input over the same range."""
    return np.clip(1.5 * lfilter([0.5], [1.0, -0.86], rng.standard_normal(N)), -2.0, 2.0)


def departure(fit, curve, deviation, seed=77):
    """Mean square of the free run's distance from the noise-free output, by the noise variance, on another input."""
    data, y = record(curve, 3000, 0.0, seed, last=noise)
    return float(np.mean((fit.simulate(data)[100:] - y[100:]) ** 2)) / deviation**2


def test_changes_of_slope_are_those_of_the_curve():
    block = PiecewiseLinear(knots=5, free_knots=False, at=(-1.0, 0.0, 0.5, 2.0, 5.0))
    theta = np.array([2.0, 1.0, 1.0, 4.0, 1.0])
    np.testing.assert_allclose(block.slope_changes() @ theta, [1.0, 2.0, -3.0], atol=1e-14)
    assert PiecewiseLinear(knots=5).slope_changes().shape == (0, 10)


def test_a_finer_map_is_the_same_curve_with_break_points_over_the_whole_signal():
    rng = np.random.default_rng(2)
    block = PiecewiseLinear(knots=6)
    theta = np.concatenate([np.linspace(-1.0, 2.0, 6), rng.normal(size=6)])
    x = np.linspace(-1.6, 3.1, 500)
    finer, values = block.finer(theta, x, 40)
    assert finer.knots == 40
    assert finer.at[0] == x.min()
    assert finer.at[-1] == x.max()
    assert np.diff(finer.at).max() < 4.7 / 20
    np.testing.assert_allclose(finer.output(values, x), block.output(theta, x), atol=1e-12)
    assert finer.finer(values, 10.0 * x, 80)[0] is finer  # places that are given stay


def test_the_effective_number_of_parameters_is_the_trace_of_the_hat_matrix():
    rng = np.random.default_rng(3)
    J, W = rng.normal(size=(200, 6)), 5.0 * rng.normal(size=(4, 6))
    full = Linearisation.of(np.zeros(204), np.vstack([J, W]))
    expected = np.trace(J @ np.linalg.inv(J.T @ J + W.T @ W) @ J.T)
    assert effective_count(Linearisation.of(np.zeros(200), J), full) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("seed", range(12 if FULL else 3))
def test_a_smooth_curve_is_followed_where_ten_break_points_cannot(seed):
    """60 dB: ten lines miss a cubic curve by 700 times the variance of the noise, fifty by 2 to 5 (eight seeds)."""
    deviation = 1e-3
    data, _ = record(_cubic, 1500, deviation, seed)
    coarse, fine = (sysid.fit(wiener(1, 2, 1), data, objective=o) for o in (Objective(), FINE))
    assert departure(fine, _cubic, deviation) < min(10.0, 0.02 * departure(coarse, _cubic, deviation))
    np.testing.assert_allclose(np.sort(fine.poles), np.sort(np.roots([1.0, -1.2, 0.56])), atol=2e-3)


@pytest.mark.parametrize("seed", range(12 if FULL else 3))
def test_a_corner_stays_a_corner(seed):
    """A saturation at 30 dB: what fifty break points cost beside two known ones is a small part of the noise."""
    deviation = 0.03
    data, _ = record(_saturation, 1500, deviation, seed)
    fine = sysid.fit(wiener(1, 2, 1), data, objective=FINE)
    assert departure(fine, _saturation, deviation) < 0.05
    block, theta = fine.model.blocks[-1], fine.model.part(fine.theta, fine.model.blocks[-1])
    slopes = np.diff(theta) / np.diff(block.at)
    flat = np.abs(slopes) < 0.05 * np.abs(slopes).max()
    assert flat[0]
    assert flat[-1]


def test_without_a_curve_hardly_any_parameter_is_spent_on_one():
    """A linear plant, noise as large as its output: the effective number is near that of the filter and a line."""
    data, _ = record(lambda x: x, 600, 1.0, 5)
    fine = sysid.fit(hammerstein_wiener(1, 2, 1), data, objective=FINE)
    line = sysid.fit(sysid.structures.output_error(1, 2, 1), data)
    assert fine.criteria.d < line.criteria.d + 8
    assert departure(fine, lambda x: x, 1.0) < 0.05


def test_a_record_in_other_units_gives_the_same_fit():
    data, _ = record(_cubic, 800, 0.02, 4)
    other = IOData(1024.0 * data.u, data.y / 1024.0, data.Ts)
    one, two = (sysid.fit(hammerstein_wiener(1, 2, 1), d, objective=FINE) for d in (data, other))
    np.testing.assert_allclose(1024.0 * two.simulate(other), one.simulate(data), atol=1e-9)
    assert one.criteria.d == two.criteria.d
    np.testing.assert_allclose(two.pole_std, one.pole_std, rtol=1e-6)


def test_experiments_and_gaps_and_a_file_again(tmp_path):
    parts = [record(_cubic, N, 0.02, 8)[0] for N in (500, 400)]
    lost = np.random.default_rng(1).uniform(size=500) < 0.2
    parts[0] = IOData(parts[0].u, np.where(lost, 1e3, parts[0].y[:, 0]), 1.0, missing=lost)
    fit = sysid.fit(wiener(1, 2, 1), IOData.merge(*parts), objective=FINE)
    assert departure(fit, _cubic, 0.02) < 0.3
    again = sysid.load(fit.save(tmp_path / "fit.json"))
    np.testing.assert_array_equal(again.simulate(parts[1]), fit.simulate(parts[1]))


def test_what_is_held_or_given_stays():
    data, _ = record(_cubic, 500, 0.02, 9)
    given = hammerstein(1, 2, 1, input=PiecewiseLinear.evenly_spaced(data.u, 7, role="input"))
    assert sysid.fit(given, data, objective=FINE).model.blocks[0].knots == 7
    model = wiener(1, 2, 1, fixed={"output.x5": 0.1})
    assert sysid.fit(model, data, objective=FINE).model.blocks == model.blocks
    linear = sysid.structures.output_error(1, 2, 1)
    np.testing.assert_array_equal(sysid.fit(linear, data, objective=FINE).theta, sysid.fit(linear, data).theta)


@pytest.mark.parametrize(
    ("options", "words"), [({"knots": 5}, "at least 12"), ({"knots": 50, "ridge": 1.0}, "not both")]
)
def test_an_objective_that_cannot_be(options, words):
    with pytest.raises(sysid.InputError, match=words):
        Objective(**options)


def _cubic(x):
    return x + 0.3 * x**3


def _saturation(x):
    return np.clip(x, -1.1, 0.8)

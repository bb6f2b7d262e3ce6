"""A smooth travel map against SciPy's natural spline through the same shares, and what becomes of one that falls."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sysid.blocks import TravelMap

LOW, HIGH = -0.9, 0.4


def spline(shares: np.ndarray) -> CubicSpline:
    """The natural spline of s over the stroke."""
    return CubicSpline(np.linspace(0.0, 1.0, len(shares)), shares, bc_type="natural")


def theta_of(shares: np.ndarray) -> np.ndarray:
    return np.concatenate([[LOW, HIGH], shares[1:-1]])


def drawn(knots: int, seed: int, spread: float) -> np.ndarray:
    """Shares about a straight line, in steps of 1 - spread to 1 + spread of the mean one."""
    steps = np.random.default_rng([seed, knots]).uniform(1.0 - spread, 1.0 + spread, knots - 1)
    return np.concatenate([[0.0], np.cumsum(steps / steps.sum())])


def shown(knots: int, theta: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y and its slope."""
    return TravelMap(knots, smooth=True).evaluate(theta, x, np.empty((len(x), 0)), 0)


@pytest.mark.parametrize("knots", [3, 4, 6, 9, 15])
def test_a_smooth_map_is_the_natural_spline_and_goes_on_straight_beyond_its_ends(knots: int) -> None:
    shares = drawn(knots, 1, 0.9)
    known, x = spline(shares), np.linspace(-0.4, 1.4, 1801)
    inside = np.clip(x, 0.0, 1.0)
    y, slope = shown(knots, theta_of(shares), x)
    expected = known(inside) + known(inside, 1) * (x - inside)
    np.testing.assert_allclose(y, LOW + (HIGH - LOW) * expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(slope, (HIGH - LOW) * known(inside, 1), rtol=0, atol=1e-11)


def test_two_knots_leave_a_straight_line_with_and_without_smooth() -> None:
    x = np.linspace(-0.4, 1.4, 19)
    for smooth in (True, False):
        y, slope = TravelMap(2, smooth=smooth).evaluate(np.array([LOW, HIGH]), x, np.empty((19, 0)), 0)
        np.testing.assert_allclose(y, LOW + (HIGH - LOW) * x, atol=1e-14)
        np.testing.assert_allclose(slope, HIGH - LOW, atol=1e-13)


@pytest.mark.parametrize("knots", [3, 5, 9])
def test_a_map_that_falls_is_repaired_into_one_that_a_search_may_take(knots: int) -> None:
    block = TravelMap(knots, smooth=True)
    for seed in range(100):
        shares = drawn(knots, seed, 2.0)  # steps of -1 to 3: many fall
        theta = theta_of(shares)
        again = block.repair(theta)
        assert block.admissible(again)
        np.testing.assert_array_equal(again[:2], theta[:2])  # the ends stay where they are
        np.testing.assert_array_equal(block.repair(again), again)
        if spline(shares)(np.linspace(0.0, 1.0, 1001), 1).min() > 0.05:
            np.testing.assert_array_equal(again, theta)  # what rises well is left alone


@pytest.mark.parametrize("knots", [5, 9])
def test_a_map_that_a_search_may_take_never_falls(knots: int) -> None:
    block, fine = TravelMap(knots, smooth=True), np.linspace(0.0, 1.0, 4001)
    for seed in range(200):
        theta = block.repair(theta_of(drawn(knots, seed, 2.0)))
        assert spline(np.concatenate([[0.0], theta[2:], [1.0]]))(fine, 1).min() > 0.0

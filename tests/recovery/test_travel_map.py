"""A smooth travel map against SciPy's spline through the same shares, and what becomes of one that falls."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sysid.base.errors import InputError
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


@pytest.mark.parametrize("knots", [4, 6, 9])
def test_a_map_with_bent_ends_is_the_spline_without_a_knot_beside_them(knots: int) -> None:
    shares = drawn(knots, 2, 0.9)
    known, x = CubicSpline(np.linspace(0.0, 1.0, knots), shares), np.linspace(0.0, 1.0, 1001)
    y, slope = TravelMap(knots, smooth=True, bent_ends=True).evaluate(theta_of(shares), x, np.empty((1001, 0)), 0)
    np.testing.assert_allclose(y, LOW + (HIGH - LOW) * known(x), rtol=0, atol=1e-12)
    np.testing.assert_allclose(slope, (HIGH - LOW) * known(x, 1), rtol=0, atol=1e-11)
    with pytest.raises(InputError, match="need a smooth travel map of 4 knots, and this one has 3"):
        TravelMap(3, smooth=True, bent_ends=True)


def test_a_linkage_near_its_dead_centre_is_followed_at_its_ends() -> None:
    """The angle of a triangle whose third side an actuator makes longer, by the law of cosines, to 140 degrees."""
    a, b = 0.08, 0.05
    longest = np.sqrt(a**2 + b**2 - 2.0 * a * b * np.cos(np.deg2rad(140.0)))
    x = np.linspace(0.0, 1.0, 1001)
    side = 0.06 + (longest - 0.06) * x
    angle = np.arccos((a**2 + b**2 - side**2) / (2.0 * a * b))
    share, knots = (angle - angle[0]) / np.ptp(angle), 9
    off = []
    for bent in (True, False):
        block = TravelMap(knots, smooth=True, bent_ends=bent)
        at_knots = np.concatenate([angle[[0, -1]], share[:: 1000 // (knots - 1)][1:-1]])
        off.append(np.abs(block.output(at_knots, x) - angle).max())
    assert off[0] < 0.4 * off[1]


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

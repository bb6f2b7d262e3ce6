"""Options of the blocks meet the contracts of the blocks; and what each map promises beyond them."""

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from sysid.blocks import CubicSpline, Custom, DeadZoneSaturation, PiecewiseLinear, TransferFunction, WaveletNetwork
from sysid.model.chain import Chain
from sysid.structures import hammerstein_wiener

LINEAR = np.array([0.2, 0.12, -1.2, 0.5, 0.3, -0.4])


def output(block, theta, x):
    return block.propagate(theta, x, np.empty((len(x), 0)), 0)


@pytest.mark.parametrize("name", sorted(VARIANTS | MOVING))
@given(seed=st.integers(0, 2**32 - 1))
def test_jacobian_and_tangent_agree_with_finite_differences(name, seed):
    block, theta = (VARIANTS | MOVING)[name]
    rng = np.random.default_rng(seed)
    theta = theta * (1.0 + 0.03 * rng.uniform(-1, 1, len(theta)))
    x = rng.uniform(-2, 2, 60)
    x = x[np.min(np.abs(x[:, None] - np.array(getattr(block, "at", 9.0) or 9.0, ndmin=1)), axis=1) > 1e-3]
    J = np.ones((len(x), 1 + block.n_parameters))
    block.propagate(theta, x, J, 1)

    def differences(h):
        across = [output(block, theta, x + h) - output(block, theta, x - h)]
        across += [output(block, theta + e, x) - output(block, theta - e, x) for e in h * np.eye(len(theta))]
        return np.array(across).T / (2 * h)

    # Without the error of second order, which a strike at low speed makes large.
    numeric = (4.0 * differences(5e-7) - differences(1e-6)) / 3.0
    np.testing.assert_allclose(J, numeric, atol=1e-6 * max(1.0, np.abs(J).max()))


@pytest.mark.parametrize("name", sorted(VARIANTS))
def test_variant_starts_near_the_identity_and_varies_admissibly(name):
    block, theta = VARIANTS[name]
    x = np.random.default_rng(2).uniform(-1.5, 1.5, 200)
    start = block.start(x)
    assert block.admissible(start)
    np.testing.assert_allclose(output(block, start, x), x, atol=1e-12)
    for seed in range(20):
        assert block.admissible(block.vary(theta, np.random.default_rng(seed)))


@pytest.mark.parametrize("name", [*sorted(VARIANTS), "custom"])
@pytest.mark.parametrize("place", ["input", "output"])
def test_gauge_is_all_and_only_what_is_redundant(name, place):
    (block, own), (other, rest) = {**VARIANTS, **BLOCKS}[name], BLOCKS["polynomial"]
    maps, parts = ((block, other), (own, rest)) if place == "input" else ((other, block), (rest, own))
    chain = hammerstein_wiener(2, 2, 1, *maps)
    rng = np.random.default_rng(3)
    theta = np.concatenate([parts[0], LINEAR, parts[1]])
    theta, u = theta * (1.0 + 0.05 * rng.uniform(-1, 1, len(theta))), rng.uniform(-3, 3, 4000)
    _, J = chain.tangent(theta, u)
    norm = np.linalg.norm(J, axis=0)
    s = np.linalg.svd(J / norm, compute_uv=False)
    G = chain.gauge(theta)
    # Differences of a custom map are good to 1e-9, so its redundant directions leave that much behind.
    assert np.sum(s > 1e-7 * s[0]) == len(theta) - G.shape[1]
    assert np.abs(J @ G).max() < 1e-6 * norm.max() * np.abs(G).max()


def test_natural_spline_is_scipys_inside_and_straight_outside():
    from scipy.interpolate import CubicSpline as Reference

    block, theta = BLOCKS["cubic_spline"]
    knots = np.linspace(theta[0], theta[1], 5)
    reference = Reference(knots, theta[2:], bc_type="natural")
    inside, beyond = np.linspace(theta[0], theta[1], 101), np.linspace(theta[1], theta[1] + 3.0, 7)
    np.testing.assert_allclose(output(block, theta, inside), reference(inside), atol=1e-12)
    line = theta[-1] + reference(theta[1], 1) * (beyond - theta[1])
    np.testing.assert_allclose(output(block, theta, beyond), line, atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_monotone_spline_never_falls_and_has_no_jump_in_curvature(seed):
    rng = np.random.default_rng(seed)
    block = CubicSpline(knots=6, monotone=True, span=(0.0, 1.0), role="map")
    theta = np.concatenate([[0.3], rng.exponential(size=7) * (rng.uniform(size=7) > 0.4)])
    x = np.linspace(-0.5, 1.5, 4001)
    y = output(block, theta, x)
    assert np.all(np.diff(y) >= -1e-12)
    curvature = np.diff(y[1001:3000], 2)  # inside the span
    assert np.abs(np.diff(curvature)).max() < 40.0 * np.abs(theta).max() * (x[1] - x[0]) ** 3 * 5.0**2


def test_dead_zone_saturation_has_four_corners_and_two_slopes():
    block = DeadZoneSaturation(role="map")
    theta = np.array([-2.0, -0.5, 0.25, 1.0, 2.0, 4.0])
    x = np.array([-9.0, -2.0, -1.0, -0.5, 0.0, 0.25, 0.5, 1.0, 9.0])
    np.testing.assert_allclose(output(block, theta, x), [-3.0, -3.0, -1.0, 0.0, 0.0, 0.0, 1.0, 3.0, 3.0])
    closed = block.repair(np.array([-2.0, 0.3, 0.1, 1.0, 2.0, 4.0]))
    assert block.admissible(closed)
    np.testing.assert_allclose(closed[1:3], 0.2)


def test_wavelet_and_scaling_function_have_their_textbook_values():
    block = WaveletNetwork(wavelets=1, scaling=1, role="map")
    theta = np.array([0.0, 0.0, 1.0, 10.0, 2.0, 1.0, 0.5, 0.0])
    x = np.array([0.5, 1.0, 1.5])  # z = 0, 1, 2 of the wavelet
    expected = np.array([1.0, 0.0, -3.0 * np.exp(-2.0)]) + 10.0 * np.exp(-0.5 * x**2)
    np.testing.assert_allclose(output(block, theta, x), expected)


def test_custom_map_takes_given_derivatives_and_finds_its_own_gauge():
    exact = Custom(
        f=lambda x, theta: theta[0] * np.tanh(theta[1] * x),
        names=("gain", "bend"),
        initial=(1.0, 0.5),
        slope=lambda x, theta: theta[0] * theta[1] / np.cosh(theta[1] * x) ** 2,
        jacobian=lambda x, theta: np.column_stack(
            [np.tanh(theta[1] * x), theta[0] * x / np.cosh(theta[1] * x) ** 2],
        ),
        role="input",
    )
    theta, x = np.array([1.3, 0.8]), np.linspace(-2, 2, 50)
    rough = Custom(f=exact.f, names=exact.names, initial=exact.initial, role="input")
    J, K = np.ones((50, 3)), np.ones((50, 3))
    exact.propagate(theta, x, J, 1)
    rough.propagate(theta, x, K, 1)
    np.testing.assert_allclose(J, K, atol=1e-8)
    # A gain before and a gain behind can be taken over; an offset cannot.
    assert len(exact.symmetries(theta)) == len(rough.symmetries(theta)) == 2
    chain = Chain((rough, TransferFunction(1, 1, 1, role="linear")))
    assert chain.gauge(np.concatenate([theta, [0.5, -0.8, 0.1]])).shape[1] == 1


def test_fixed_knots_leave_only_values_and_lie_over_the_data():
    block = PiecewiseLinear.evenly_spaced(np.array([-3.0, 1.0, 5.0]), knots=5, role="input")
    assert block.at == (-3.0, -1.0, 1.0, 3.0, 5.0)
    assert [s.name for s in block.slots()] == ["y1", "y2", "y3", "y4", "y5"]
    placed = PiecewiseLinear(knots=3, at=(0.0, 1.0, 4.0), role="input")
    np.testing.assert_allclose(placed.start(np.array([-9.0, 9.0]))[:3], [0.0, 1.0, 4.0])


def test_impossible_maps_are_refused_in_a_sentence():
    with pytest.raises(InputError, match="evenly_spaced"):
        PiecewiseLinear(free_knots=False)
    with pytest.raises(InputError, match="rising order"):
        PiecewiseLinear(knots=3, at=(0.0, 2.0, 1.0))
    with pytest.raises(InputError, match="at least 3"):
        CubicSpline(knots=2)
    with pytest.raises(InputError, match="first below the second"):
        CubicSpline(span=(1.0, 1.0))
    with pytest.raises(InputError, match="at least 1 unit"):
        WaveletNetwork(0, 0)
    with pytest.raises(InputError, match="one of each"):
        Custom(f=lambda x, theta: x, names=("a",), initial=())
    with pytest.raises(InputError, match="one finite value for each sample"):
        Custom(f=lambda x, theta: 1.0 / (x * 0.0))

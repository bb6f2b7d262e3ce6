"""Every block: exact Jacobian, exact tangent, true symmetries, harmless start."""

import numpy as np
import pytest
from cases import BLOCKS
from hypothesis import given
from hypothesis import strategies as st

from sysid.block import StaticBlock
from sysid.blocks import STATIC, TABLE


def away_from_kinks(block, theta, x):
    """Samples whose map is smooth within the finite-difference step, which needs two-sided derivatives."""
    return x[np.all(np.abs(x[:, None] - theta[None, :]) > 1e-3, axis=1)] if isinstance(block, StaticBlock) else x


def test_every_registered_block_has_a_case():
    assert sorted(BLOCKS) == sorted(TABLE)


@pytest.mark.parametrize("name", sorted(TABLE))
@given(seed=st.integers(0, 2**32 - 1))
def test_jacobian_and_tangent_agree_with_finite_differences(name, seed):
    block, theta = BLOCKS[name]
    rng = np.random.default_rng(seed)
    theta = theta * (1.0 + 0.03 * rng.uniform(-1, 1, len(theta)))
    x = away_from_kinks(block, theta, rng.uniform(-2, 2, 60))
    dx = rng.normal(size=(len(x), 2))
    J = np.zeros((len(x), 2 + block.n_parameters))
    J[:, :2] = dx
    block.propagate(theta, x, J, 2)

    def output(theta, x):
        return block.propagate(theta, x, np.empty((len(x), 0)), 0)

    h = 1e-6
    numeric = [(output(theta, x + h * d) - output(theta, x - h * d)) / (2 * h) for d in dx.T]
    for i in range(block.n_parameters):
        e = np.zeros_like(theta)
        e[i] = h
        numeric.append((output(theta + e, x) - output(theta - e, x)) / (2 * h))
    # 1e-6 relative to the largest entry: central differences with h = 1e-6 are good to about 1e-9.
    np.testing.assert_allclose(J, np.array(numeric).T, atol=1e-6 * max(1.0, np.abs(J).max()))


@pytest.mark.parametrize("name", sorted(TABLE))
def test_symmetries_do_what_they_claim(name):
    block, theta = BLOCKS[name]
    x = away_from_kinks(block, theta, np.random.default_rng(1).uniform(-2, 2, 80))

    def output(eps, s):
        moved = x + eps * (s.in_scale * x + s.in_shift)
        return block.propagate(theta + eps * s.d_theta, moved, np.empty((len(x), 0)), 0)

    y = block.propagate(theta, x, np.empty((len(x), 0)), 0)
    for s in block.symmetries(theta):
        slope = (output(1e-6, s) - output(-1e-6, s)) / 2e-6
        np.testing.assert_allclose(slope, s.out_scale * y + s.out_shift, atol=1e-6 * max(1.0, np.abs(y).max()))


@pytest.mark.parametrize("name", sorted(STATIC))
def test_start_is_near_the_identity_and_admissible(name):
    block = STATIC[name](role="map")
    x = np.random.default_rng(2).uniform(-3, 5, 500)
    theta = block.start(x)
    assert block.admissible(theta)
    y = block.propagate(theta, x, np.empty((len(x), 0)), 0)
    # A dead zone or a saturation starts with a tenth of the range bent, the others are exact.
    assert np.abs(y - x).max() <= 0.1 * np.ptp(x)


@pytest.mark.parametrize("name", sorted(TABLE))
@given(seed=st.integers(0, 2**32 - 1))
def test_variations_stay_admissible(name, seed):
    block, theta = BLOCKS[name]
    varied = block.vary(theta, np.random.default_rng(seed))
    assert varied.shape == theta.shape
    assert block.admissible(varied)

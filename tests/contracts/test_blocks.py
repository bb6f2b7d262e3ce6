"""Every block: exact Jacobian, exact tangent, true symmetries, harmless start."""

import copy
import pickle
from dataclasses import fields

import numpy as np
import pytest
from cases import BLOCKS
from hypothesis import given
from hypothesis import strategies as st

from sysid.block.block import StaticBlock
from sysid.blocks import STATIC, TABLE, Channels


def test_every_registered_block_has_a_case():
    assert sorted(BLOCKS) == sorted(TABLE)


def run(block, theta, X, dX=None, own=False):
    """Outputs (n_out, N) for inputs X (n_in, N); with dX (n_in, N, 2) or `own` also their tangents (n_out, N, P)."""
    q = 0 if dX is None else dX.shape[2]
    Js = [np.zeros((X.shape[1], q + block.n_parameters if own or q else 0)) for _ in X]
    for i in range(len(X) if q else 0):
        Js[i][:, :q] = dX[i]
    ys, Js = block.propagate_all(theta, list(X), Js, q)
    return (np.array(ys), np.array(Js)) if own or q else np.array(ys)


def inputs(block, theta, seed, N=60):
    """Channels (n_in, N) uniform in [-2, 2], away from kinks."""
    x = np.random.default_rng(seed).uniform(-2, 2, (block.channels[0], 4 * N))
    if not isinstance(block, StaticBlock | Channels):
        return x[:, :N]
    near = np.abs(x[:, :, None] - theta[None, None, :]) < 1e-3  # differences need a smooth map around the sample
    return x[:, ~near.any(axis=(0, 2))][:, :N]


@pytest.mark.parametrize("name", sorted(TABLE))
@given(seed=st.integers(0, 2**32 - 1))
def test_jacobian_and_tangent_agree_with_finite_differences(name, seed):
    block, theta = BLOCKS[name]
    rng = np.random.default_rng(seed)
    theta = theta * (1.0 + 0.03 * rng.uniform(-1, 1, len(theta)))
    X = inputs(block, theta, seed)
    dX = rng.normal(size=(*X.shape, 2))
    _, J = run(block, theta, X, dX)
    h = 1e-6
    numeric = [
        (run(block, theta, X + h * dX[:, :, k]) - run(block, theta, X - h * dX[:, :, k])) / (2 * h) for k in (0, 1)
    ]
    for i in range(block.n_parameters):
        e = np.zeros_like(theta)
        e[i] = h
        numeric.append((run(block, theta + e, X) - run(block, theta - e, X)) / (2 * h))
    # 1e-6 relative to the largest entry: central differences with h = 1e-6 are good to about 1e-9.
    np.testing.assert_allclose(J, np.moveaxis(numeric, 0, 2), atol=1e-6 * max(1.0, np.abs(J).max()))


@pytest.mark.parametrize("name", sorted(TABLE))
def test_symmetries_do_what_they_claim(name):
    block, theta = BLOCKS[name]
    X = inputs(block, theta, 1)

    def column(value, n):
        return np.broadcast_to(value, (n,))[:, None]

    def output(eps, s):
        n = block.channels[0]
        return run(block, theta + eps * s.d_theta, X + eps * (column(s.in_scale, n) * X + column(s.in_shift, n)))

    Y = run(block, theta, X)
    for s in block.symmetries(theta):
        slope = (output(1e-6, s) - output(-1e-6, s)) / 2e-6
        claimed = column(s.out_scale, len(Y)) * Y + column(s.out_shift, len(Y))
        np.testing.assert_allclose(slope, claimed, atol=1e-6 * max(1.0, np.abs(Y).max()))


@pytest.mark.parametrize("name", sorted(STATIC))
def test_start_is_near_the_identity_and_admissible(name):
    block = STATIC[name](role="map")
    x = np.random.default_rng(2).uniform(-3, 5, 500)
    theta = block.start(x)
    assert block.admissible(theta)
    y = block.propagate(theta, x, np.empty((len(x), 0)), 0)
    # Most are exact; what is only its limits starts with up to a tenth of the range bent.
    assert np.abs(y - x).max() <= 0.1 * np.ptp(x)


@pytest.mark.parametrize("name", sorted(TABLE))
@given(seed=st.integers(0, 2**32 - 1))
def test_variations_stay_admissible(name, seed):
    block, theta = BLOCKS[name]
    varied = block.vary(theta, np.random.default_rng(seed))
    assert varied.shape == theta.shape
    assert block.admissible(varied)


@pytest.mark.parametrize("name", sorted(TABLE))
def test_a_block_that_has_run_is_copied_and_sent_to_another_process(name):
    block, theta = BLOCKS[name]
    if not all(map(sendable, (getattr(block, f.name) for f in fields(block)))):
        pytest.skip("its functions have no name that another process could look up")
    X = inputs(block, theta, 1)
    first = run(block, theta, X)
    for other in (copy.deepcopy(block), pickle.loads(pickle.dumps(block))):
        np.testing.assert_array_equal(run(other, theta, X), first)


def sendable(value):
    try:
        pickle.dumps(value)
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True


@pytest.mark.parametrize("name", sorted(STATIC))
@given(seed=st.integers(0, 2**32 - 1))
def test_a_straight_map_is_a_line_over_the_range(name, seed):
    """Some families have no line, and then straight is the start; those with one have it to 1e-5 of the range."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, 200) * 10.0 ** rng.uniform(-3, 3) + rng.uniform(-2, 2)
    block = STATIC[name]()
    theta = block.straight(x)
    assert block.admissible(theta)
    y = block.output(theta, x)
    left = y - np.polyval(np.polyfit(x, y, 1), x)
    bent = block.output(block.start(x), x)
    worst = np.abs(bent - np.polyval(np.polyfit(x, bent, 1), x)).max()
    assert np.abs(left).max() <= max(1e-5 * np.abs(x).max(), worst)
    if name in ("saturation", "dead_zone", "dead_zone_saturation"):
        assert np.abs(left).max() <= 1e-5 * np.abs(x).max()
        assert np.abs(y - x).max() <= 1e-5 * np.abs(x).max()

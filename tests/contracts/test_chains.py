"""Chains: exact Jacobians, and a gauge that explains every rank defect of them."""

import itertools

import numpy as np
import pytest
from cases import BLOCKS, MOVING, STRUCTURES, VARIANTS
from often import often
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.blocks import STATIC, Polynomial, TransferFunction
from sysid.data.record import IOData
from sysid.estimation.starts import starts
from sysid.model.chain import Chain
from sysid.structures import hammerstein_wiener

LINEAR = np.array([0.2, 0.12, -1.2, 0.5, 0.3, -0.4])  # nb 2, nf 2, nk 1: gain about 1, poles 0.6 +- 0.37i


def generic(first, last, N=4000):
    """A Hammerstein-Wiener chain of the cases' maps at an interior point, and an input that excites all of it."""
    (input_map, a), (output_map, b) = BLOCKS[first], BLOCKS[last]
    chain = hammerstein_wiener(2, 2, 1, input_map, output_map)
    rng = np.random.default_rng(3)
    theta = np.concatenate([a, LINEAR, b])
    return chain, theta * (1.0 + 0.05 * rng.uniform(-1, 1, len(theta))), rng.uniform(-3, 3, N)


@pytest.mark.parametrize(("first", "last"), list(itertools.product(sorted(STATIC), repeat=2)))
def test_gauge_is_all_and_only_what_is_redundant(first, last):
    """Rank of the Jacobian at a generic point = parameters - gauge, and the output does not move along the gauge."""
    chain, theta, u = generic(first, last)
    _, J = chain.tangent(theta, u)
    norm = np.linalg.norm(J, axis=0)
    s = np.linalg.svd(J / np.where(norm > 0, norm, 1.0), compute_uv=False)
    G = chain.gauge(theta)
    assert np.sum(s > 1e-9 * s[0]) == len(theta) - G.shape[1]
    if G.shape[1]:
        assert np.abs(J @ G).max() < 1e-9 * norm.max() * np.abs(G).max()


def test_signals_of_a_chain_by_hand():
    """Clip, filter, parabola, each by its own formula; two channels, whose filter adds them up."""
    chain = hammerstein_wiener(2, 2, 1, "saturation", Polynomial(degree=2))
    u = np.random.default_rng(5).uniform(-3, 3, 50)
    clipped = np.clip(u, -1.1, 1.3)
    theta = np.concatenate([[-1.1, 1.3], LINEAR[:4], [0.0, 0.0], [0.3, 1.1, 0.4]])
    filtered = lfilter([0, 0.2, 0.12], [1, -1.2, 0.5], clipped)
    expected = (u, clipped, filtered, 0.3 * filtered**2 + 1.1 * filtered + 0.4)
    for found, by_hand in zip(chain.signals(theta, u), expected, strict=True):
        np.testing.assert_allclose(found, by_hand, rtol=0, atol=1e-12)
    np.testing.assert_allclose(chain.through(theta, clipped, 1, 2), filtered, rtol=0, atol=1e-12)
    np.testing.assert_allclose(chain.blocks[2].output(theta[-3:], [2, 0]), [0.3 * 4 + 1.1 * 2 + 0.4, 0.4])
    pair = hammerstein_wiener(1, 0, 0, "saturation", "unit_gain", nu=2, ny=1)
    both = np.column_stack([u, -2 * u])
    signals = pair.signals(np.array([-1.0, 1.0, -2.0, 2.0, 3.0, 5.0]), both)
    limited = np.column_stack([np.clip(u, -1, 1), np.clip(-2 * u, -2, 2)])
    np.testing.assert_array_equal(signals[1], limited)
    np.testing.assert_allclose(signals[-1], limited @ [3.0, 5.0], rtol=0, atol=1e-12)


def test_a_fixed_gain_takes_its_gauge_away():
    chain, theta, _ = generic("polynomial", "polynomial")
    held = Chain(chain.blocks, fixed={"linear.b0": theta[chain.names.index("linear.b0")]})
    # One parameter less and one redundancy less: the number that counts stays.
    assert held.gauge(theta).shape[1] == chain.gauge(theta).shape[1] - 1
    assert held.count(theta) == chain.count(theta)


@pytest.mark.parametrize(
    "name", [name for name, recipe in STRUCTURES.items() if getattr(recipe.model(), "dynamics", ())]
)
def test_chain_jacobian_agrees_with_finite_differences(name):
    """Each structure at its automatic start, moved off it at random."""
    rng = np.random.default_rng(4)
    chain, u = STRUCTURES[name].model(), rng.uniform(-2, 2, 300)
    theta = starts(chain, IOData(u, np.convolve(u, [0, 0.5, 0.3, 0.1])[:300]), 1, 0)[0]
    theta = theta + 0.05 * rng.normal(size=len(theta))
    y, J = chain.tangent(theta, u)
    np.testing.assert_array_equal(y, chain.simulate(theta, u))
    h = 1e-6
    for i in range(len(theta)):
        e = np.zeros_like(theta)
        e[i] = h
        numeric = (chain.simulate(theta + e, u) - chain.simulate(theta - e, u)) / (2 * h)
        # Median over samples: a sample within h of a kink has no two-sided derivative.
        assert np.median(np.abs(J[:, i] - numeric)) < 1e-6 * max(1.0, np.abs(J[:, i]).max())


def test_unknown_names_list_the_known_ones():
    with pytest.raises(InputError, match="saturation"):
        hammerstein_wiener(input="staircase")
    with pytest.raises(InputError, match=r"linear\.f1"):
        Chain(hammerstein_wiener().blocks, fixed={"linear.f9": 0.0})


@pytest.mark.parametrize("orders", [(0, 2, 1), (2, -1, 1), (2, 2, -1), (2.0, 2, 1)])
def test_impossible_orders_are_refused(orders):
    with pytest.raises(InputError, match="nb >= 1"):
        TransferFunction(*orders)


def test_kinks_are_exact_and_no_gauge_moves_them():
    chain, theta, _ = generic("piecewise_linear", "piecewise_linear")
    kink, d = chain.kinks(theta)
    assert len(kink) == 2 * 3  # five knots have three inner ones
    h = 1e-6
    for i in range(len(theta)):
        e = np.zeros_like(theta)
        e[i] = h
        numeric = (chain.kinks(theta + e)[0] - chain.kinks(theta - e)[0]) / (2 * h)
        np.testing.assert_allclose(d[:, i], numeric, atol=1e-6 * np.abs(d).max())
    np.testing.assert_allclose(d @ chain.gauge(theta), 0.0, atol=1e-9 * np.abs(d).max())


@pytest.mark.parametrize(
    ("name", "inner"),
    [("piecewise_linear", 3), ("piecewise_linear_fixed", 3), ("travel_map", 3), ("travel_map_smooth", 3),
     ("profiled_motor", 2)],
)  # fmt: skip
def test_every_map_on_knots_gives_its_kinks_with_their_derivative(name, inner):
    """One at each inner knot of every curve: a fit's curvature weight is without effect on a block that gives none."""
    block, theta = (BLOCKS | VARIANTS | MOVING)[name]
    kink, d = block.kinks(theta)
    assert len(kink) == inner
    assert np.abs(kink).max() > 0.05
    h = 1e-6
    for i, e in enumerate(h * np.eye(len(theta))):
        numeric = (block.kinks(theta + e)[0] - block.kinks(theta - e)[0]) / (2 * h)
        np.testing.assert_allclose(d[:, i], numeric, atol=1e-6 * np.abs(d).max())


@pytest.mark.parametrize("seed", often(200, 60))
def test_admissible_is_what_the_roots_say(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    pairs = rng.uniform(0.2, 1.1, n // 2) * np.exp(1j * rng.uniform(0, np.pi, n // 2))
    roots = np.concatenate([pairs, pairs.conj(), rng.uniform(-1.1, 1.1, n % 2)])
    block = TransferFunction(1, n, 1, initial_state=False)
    theta = np.concatenate([[1.0], np.real(np.poly(roots))[1:]])
    assert block.admissible(theta) == bool(np.all(np.abs(roots) <= 1.0))


def test_repair_parts_knots_that_met_and_leaves_others_alone():
    block, theta = BLOCKS["piecewise_linear"]
    assert block.repair(theta) is theta
    met = theta.copy()
    met[2] = met[1] - 0.01  # the third knot has passed the second
    assert not block.admissible(met)
    repaired = block.repair(met)
    assert block.admissible(repaired)
    np.testing.assert_array_equal(np.delete(repaired, 2), np.delete(met, 2))

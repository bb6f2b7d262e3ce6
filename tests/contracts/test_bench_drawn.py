"""Drawn plants: what is drawn is what is claimed, and every plant can be found from its true parameters."""

from collections import Counter

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.bench import cell, suites
from sysid.bench.cell import Cell
from sysid.bench.drawing.maps import MAPS
from sysid.bench.drawing.signals import NOISES, noise
from sysid.bench.methods import TABLE as METHODS
from sysid.bench.scenarios import TABLE as FAMILIES
from sysid.blocks import PiecewiseLinear, Polynomial, Saturation, TransferFunction

DRAWN = FAMILIES["drawn"]
CHAINS = ("output_error", "hammerstein", "wiener", "hammerstein_wiener", "wiener_hammerstein")


def by_hand(truth, u):
    """Output from the formulas of scipy and numpy; None if the plant has a map that these do not have."""
    x, k = u, 0
    for block in truth.chain.blocks:
        p = truth.theta[k : k + len(block.slots())]
        k += len(p)
        if isinstance(block, TransferFunction):
            B, F = np.r_[np.zeros(block.nk), p[: block.nb]], np.r_[1.0, p[block.nb : block.nb + block.nf]]
            x = lfilter(B, F, x)
        elif isinstance(block, Saturation):
            x = np.clip(x, *p)
        elif isinstance(block, Polynomial):
            x = np.polyval(p, x)
        elif isinstance(block, PiecewiseLinear):
            at, y = p[: block.knots], p[block.knots :]
            first, last = (y[1] - y[0]) / (at[1] - at[0]), (y[-1] - y[-2]) / (at[-1] - at[-2])
            inside = np.interp(x, at, y)
            x = inside + first * np.minimum(x - at[0], 0.0) + last * np.maximum(x - at[-1], 0.0)
        else:
            return None
    return x


@pytest.mark.parametrize("structure", CHAINS)
def test_what_is_drawn_is_what_is_claimed(structure):
    seen, checked, orders = Counter(), 0, Counter()
    for seed in range(60):
        task = DRAWN.make(structure, 10_000 + seed)
        truth, test = task.truth, task.tests["test"]
        u = task.train.u[:, 0]
        assert 250 <= task.train.N <= 4000
        assert 1e-3 <= task.train.Ts <= 1.0
        assert np.all(np.abs(truth.poles) < 1.0)
        clean = truth.chain.simulate(truth.theta, u)
        error = task.train.y[:, 0] - clean
        snr = 10 * np.log10(clean.var() / truth.noise**2)
        assert 10.0 - 1e-9 <= snr <= 60.0 + 1e-9
        assert np.mean(error**2) == pytest.approx(truth.noise**2, rel=0.9)  # coloured noise of 250 samples scatters
        hand = by_hand(truth, u)
        if hand is not None:
            np.testing.assert_allclose(clean, hand, rtol=1e-8, atol=1e-8)
            # the test begins in motion, and what it was before has died away in its second half or not
            late, slowest = by_hand(truth, test.u[:, 0])[1000:], np.abs(truth.poles).max()
            if slowest**1000 < 1e-12:
                np.testing.assert_allclose(truth.y["test"][1000:], late, rtol=1e-6, atol=1e-6)
                assert np.abs(truth.y["test"][:20] - by_hand(truth, test.u[:, 0])[:20]).max() > 0.0
            checked += 1
        seen.update(kind for kind in (*MAPS, *NOISES, "aprbs", "multisine") if kind in task.given)
        orders[task.orders[1]] += 1
    assert checked >= 15
    assert set(NOISES) <= set(seen)
    assert {"aprbs", "multisine"} <= set(seen)
    assert set(orders) == ({1, 2, 3, 4} if structure != "wiener_hammerstein" else {1, 2})
    assert structure == "output_error" or len([name for name in MAPS if seen[name]]) >= 9


def test_long_records_are_long_and_the_recursion_stays_bounded():
    for seed in range(5):
        assert 10_000 <= DRAWN.make("wiener-long", seed).train.N <= 100_000
        u = DRAWN.make("nlarx", seed).train.u[:, 0]
        assert np.abs(DRAWN.make("nlarx", seed).train.y).max() < 50.0 * np.abs(u).max()
    with pytest.raises(InputError, match="unknown scenario of drawn 'wien'"):
        DRAWN.make("wien", 0)


def test_noise_has_the_colour_that_its_name_says():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(200_000)
    for kind in NOISES:
        v = noise(kind, u, rng)
        assert v.var() == pytest.approx(1.0, abs=0.05)
        assert np.corrcoef(v[1:], v[:-1])[0, 1] == pytest.approx(0.9 if kind == "coloured" else 0.0, abs=0.02)
        assert (np.corrcoef(v**2, u**2)[0, 1] > 0.1) == (kind == "growing with the input")


@pytest.mark.slow
def test_every_plant_can_be_found_from_its_true_parameters(seeds):
    """The bar is an optimum: its loss is not above that of the true parameters, and it predicts nearly as well."""
    lost = []
    for seed in seeds:
        for structure in CHAINS:
            row = cell.run_cell(Cell(DRAWN, structure, METHODS["from_truth"], 20_000 + seed, 60.0))
            task = DRAWN.make(structure, 20_000 + seed)
            assert row["status"] == "ok"
            clean = task.truth.chain.simulate(task.truth.theta, task.train.u[:, 0])
            assert row["loss"] <= np.mean((task.train.y[:, 0] - clean) ** 2) * (1 + 1e-9)
            lost.append(row["oracle"] - row["fit"])
    assert np.mean(np.array(lost) < 1.0) > 0.8
    assert np.median(lost) < 0.2


def test_seeds_of_the_gate_change_with_the_version():
    first = [suites.first_seed(release) for release in ("0.1.0", "0.1.1", "0.2.0")]
    assert len({seed // 1000 for seed in first}) == 3
    assert first == [suites.first_seed(release) for release in ("0.1.0", "0.1.1", "0.2.0")]

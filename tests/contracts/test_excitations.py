"""Every excitation: within its amplitude, repeatable by seed, held for the times it names."""

import numpy as np
import pytest
from cases import EXCITATIONS

from sysid.errors import InputError
from sysid.excitations import TABLE, Aprbs, Sweep, excitation


@pytest.mark.parametrize("name", sorted(TABLE))
def test_amplitude_and_seed(name):
    make = EXCITATIONS[name]
    u = make.generate(2000, 0.1, np.random.default_rng(1))
    assert u.shape == (2000,)
    assert np.abs(u).max() <= make.amplitude
    assert np.ptp(u) > make.amplitude
    np.testing.assert_array_equal(u, make.generate(2000, 0.1, np.random.default_rng(1)))


def runs(u):
    """Lengths of constant stretches."""
    edges = np.flatnonzero(np.diff(u)) + 1
    return np.diff(np.concatenate([[0], edges, [len(u)]]))


def test_sweep_edges_stand_where_they_should():
    u = Sweep(amplitude=2.0, half_period=0.3).generate(30, 0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(runs(u), np.full(10, 3))


def test_jitter_moves_every_edge_within_its_share():
    u = Sweep(amplitude=2.0, half_period=1.0, jitter=0.3).generate(100_000, 0.01, np.random.default_rng(0))
    lengths = runs(u)[1:-1]
    assert lengths.min() >= 69  # 0.7 s less one sample of rounding
    assert lengths.max() <= 131
    assert lengths.mean() == pytest.approx(100, abs=4 * 30 / np.sqrt(3 * len(lengths)))


def test_aprbs_holds_and_levels():
    u = Aprbs(amplitude=1.0, hold_min=0.5, hold_max=2.0).generate(20000, 0.1, np.random.default_rng(4))
    lengths = runs(u)[:-1]
    assert lengths.min() >= 5
    assert lengths.max() <= 20
    levels = u[np.flatnonzero(np.diff(u))]
    # Uniform levels: mean 0 and variance 1/3, within four standard errors of about 1600 levels.
    assert abs(levels.mean()) < 4 * np.sqrt(1 / 3 / len(levels))
    assert abs(levels.var() - 1 / 3) < 4 * np.sqrt(4 / 45 / len(levels))


def test_bad_arguments_say_what_is_allowed():
    with pytest.raises(InputError, match="half period above 0"):
        Sweep(half_period=0.0)
    with pytest.raises(InputError, match="hold_min <= hold_max"):
        Aprbs(hold_min=2.0, hold_max=1.0)
    with pytest.raises(InputError, match="sweep"):
        excitation("noise")

"""Multisine, prbs and chirp against what theory says of their spectrum, correlation and peak."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.diagnosis.bla import find_period
from sysid.excitations import Chirp, Multisine, Prbs
from sysid.excitations.multisine import GROUP, crest_factor

N, TS = 2000, 0.1  # ten periods of 20 s: line k of a period is bin 10 k


def drawn(make, seed=0, n=N, Ts=TS):
    return make.generate(n, Ts, np.random.default_rng(seed))


def amplitudes(u):
    """Amplitude of each bin of u (N,)."""
    return np.abs(np.fft.rfft(u)) * 2 / len(u)


# Lines k of 1 / 20 s from 0.1 to 2.0 Hz are 2 .. 40.
GRIDS = {
    "full": np.arange(2, 41),
    "odd": np.arange(3, 41, 2),
    "odd_odd": np.arange(5, 41, 4),
}


@pytest.mark.parametrize("phases", ["optimised", "schroeder", "random"])
@pytest.mark.parametrize("grid", GRIDS)
def test_multisine_has_energy_on_its_lines_alone(grid, phases, seeds):
    for seed in seeds:
        u = drawn(Multisine(3.0, 0.1, 2.0, 20.0, grid, phases), seed)
        np.testing.assert_array_equal(u[200:], u[:-200])
        a = amplitudes(u)
        excited = a[GRIDS[grid] * 10]
        np.testing.assert_allclose(excited, excited[0], rtol=1e-9)  # equal power a line
        a[GRIDS[grid] * 10] = 0.0
        assert a.max() < 1e-12
        assert np.abs(u).max() == pytest.approx(3.0)


def test_random_odd_grid_leaves_one_line_of_each_group(seeds):
    make = Multisine(3.0, 0.05, 2.0, 20.0, "random_odd")  # odd lines 1 .. 39: five groups of four
    left_out = set()
    for seed in seeds:
        on = amplitudes(drawn(make, seed))[:401:10] > 1e-9
        assert not on[::2].any()
        groups = on[1::2].reshape(-1, GROUP)
        np.testing.assert_array_equal(groups.sum(axis=1), np.full(5, GROUP - 1))
        left_out |= {tuple(group) for group in groups}
    assert len(left_out) == GROUP  # any line of a group may be the one


@pytest.mark.parametrize(
    ("make", "best"),
    [
        # Worst of 300 seeds: 1.372, 1.415, 1.606, 1.161. Schroeder: 1.664, 1.637, 1.922, 1.756. Mean of random phases:
        # 2.90, 2.68, 2.57, 3.28.
        (Multisine(1.0, 0.05, 2.0, 20.0, "full"), 1.40),
        (Multisine(1.0, 0.05, 2.0, 20.0, "odd"), 1.45),
        (Multisine(1.0, 0.05, 2.0, 20.0, "odd_odd"), 1.65),
        (Multisine(1.0, 0.05, 4.5, 50.0, "full"), 1.18),
    ],
    ids=["full", "odd", "odd_odd", "long"],
)
def test_optimised_phases_beat_schroeder_and_random(make, best, seeds):
    schroeder = crest_factor(drawn(replace(make, phases="schroeder")))
    optimised = [crest_factor(drawn(make, seed)) for seed in seeds]
    random = [crest_factor(drawn(replace(make, phases="random"), seed)) for seed in seeds]
    assert max(optimised) < min(best, 0.9 * schroeder)
    assert max(optimised) < min(random)
    assert np.mean(optimised) < 0.65 * np.mean(random)


def test_two_sines_reach_their_least_peak():
    # cos a + cos(3 a + phi): peak 1.539 times the root mean square at the best phi, on 5000 phases by 5000 times.
    t = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    least = min(np.abs(np.cos(t) + np.cos(3 * t + phi)).max() for phi in np.linspace(0, 2 * np.pi, 2000))
    u = drawn(Multisine(1.0, 0.05, 0.15, 20.0, "odd"))
    assert crest_factor(u) == pytest.approx(least, rel=2e-3)


def test_realisations_are_independent():
    """Phases of one line over seeds are spread around the circle: their mean tends to 0 as 1 / sqrt(seeds)."""
    make = Multisine(1.0, 0.05, 1.0, 20.0)
    phasors = np.array([np.fft.rfft(drawn(make, seed, 200))[1:21] for seed in range(100)])
    phasors /= np.abs(phasors)
    # The first line is left out: a start half way through the running sum settles its phase.
    assert np.abs(phasors.mean(axis=0))[1:].max() < 0.4  # P(above 0.4) = exp(-100 0.16) a line
    relative = phasors[:, :-1] * np.conj(phasors[:, 1:])
    assert np.abs(relative.mean(axis=0)).max() < 0.4


@pytest.mark.parametrize("nbits", [2, 5, 7, 10])
def test_prbs_autocorrelation_has_two_values(nbits, seeds):
    M = 2**nbits - 1
    make = Prbs(amplitude=2.0, nbits=nbits, hold=0.3)
    for seed in seeds:
        u = drawn(make, seed, 3 * M)
        bits = u[::3]
        assert set(np.unique(bits)) == {-2.0, 2.0}
        r = np.fft.ifft(np.abs(np.fft.fft(bits)) ** 2).real / M
        np.testing.assert_allclose(r, np.where(np.arange(M) == 0, 4.0, -4.0 / M), atol=1e-12)
        assert abs(bits.sum()) == 2.0  # one level more of one sign


def test_inverse_repeat_prbs_is_odd_and_has_no_mean():
    u = drawn(Prbs(amplitude=1.0, nbits=6, hold=0.1, repeat="inverse"), 3, 4 * 63)
    assert find_period(u) == 2 * 63
    np.testing.assert_array_equal(u[63:126], -u[:63])
    assert amplitudes(u[:126])[::2].max() < 1e-12  # no even harmonic


@pytest.mark.parametrize("make", [Prbs(nbits=8, hold=0.3), Multisine(), Multisine(grid="odd_odd")])
def test_an_integrator_stays_centred(make, seeds):
    for seed in seeds:
        u = drawn(make, seed, 3 * 255 if isinstance(make, Prbs) else N)
        total = np.cumsum(u - u.mean())
        assert abs(total.max() + total.min()) < 0.1 * np.ptp(total)


@pytest.mark.parametrize("repeat", ["restart", "back"])
@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_chirp_runs_through_its_band(spacing, repeat):
    """Its zero crossings stand half a cycle apart at the frequency of their time."""
    Ts, period = 0.001, 100.0
    make = Chirp(1.0, 0.2, 3.0, period, spacing, repeat)
    u = drawn(make, n=200_000, Ts=Ts)
    np.testing.assert_array_equal(u[100_000:], u[:100_000])
    t = np.flatnonzero(np.diff(np.sign(u[:100_000]))) * Ts
    measured, middle = 0.5 / np.diff(t), (t[1:] + t[:-1]) / 2
    share = middle / period
    if repeat == "back":
        share = 1 - np.abs(2 * share - 1)
    expected = 0.2 + 2.8 * share if spacing == "linear" else 0.2 * 15**share
    # A half cycle at the lowest frequency is 2.5 s, in which the frequency moves, and the mean shifts the crossings.
    np.testing.assert_allclose(measured, expected, rtol=0.06)


def test_linear_chirp_spreads_its_power_evenly():
    u = drawn(Chirp(1.0, 0.5, 3.0, 200.0))
    f = np.fft.rfftfreq(N, TS)
    power = amplitudes(u) ** 2
    octants = [power[(f >= low) & (f < low + 0.3125)].sum() for low in 0.5 + 0.3125 * np.arange(8)]
    np.testing.assert_allclose(octants, np.mean(octants), rtol=0.2)  # Fresnel ripple at the edges

"""The best linear approximation against systems whose approximation, noise and distortion are known."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

import sysid
from sysid import InputError, IOData
from sysid.base.poles import match
from sysid.diagnosis import bla
from sysid.estimation.fit_from import bla_start

B, F = [0.0, 0.5, 0.2], [1.0, -1.2, 0.5]
N, LINES = 512, np.arange(1, 161)
BEND, RMS = 0.15, 1.0


def multisine(rng, lines=LINES, n=N, rms=RMS):
    """Equal amplitudes, random phases (n,)."""
    U = np.zeros(n // 2 + 1, dtype=complex)
    U[lines] = np.exp(2j * np.pi * rng.uniform(size=len(lines)))
    u = np.fft.irfft(U, n)
    return rms * u / u.std()


def linear(w):
    return lfilter(B, F, w)


def record(rng, noise, system, lines=LINES, realisations=4, periods=6):
    parts = []
    for _ in range(realisations):
        u = np.tile(multisine(rng, lines), periods)
        y = system(u)
        parts.append(IOData(u, y + noise * rng.normal(size=len(u)), 0.1))
    return IOData.merge(*parts)


def cubic(u):
    return linear(u + BEND * u**3)


def truth(estimate):
    return freqz(B, F, 2 * np.pi * estimate.frequency * estimate.Ts)[1]


def test_linear_system_noise_and_response_are_what_they_are():
    noise = 0.1
    found = bla.estimate(record(np.random.default_rng(1), noise, linear), N)
    lines, M, P = len(LINES), 4, 5
    assert (found.realisations, found.periods, found.method) == (M, P, "robust")
    np.testing.assert_allclose(found.frequency, LINES / (N * 0.1))
    # Errors of G in units of their estimated variance: mean 20/19 (16 complex degrees give a little more), standard
    # error 1/sqrt(160).
    score = np.mean(np.abs(found.G - truth(found)) ** 2 / found.noise_variance)
    assert abs(score - 20 / 19) < 4 / np.sqrt(lines)
    # The noise itself: |U|^2 = (N/2)^2 A^2, A^2 = 2 rms^2 / lines; white noise has N noise^2 in each line.
    expected = N * noise**2 / ((N / 2) ** 2 * 2 * RMS**2 / lines) / (M * P)
    assert np.mean(found.noise_variance) == pytest.approx(expected, rel=4 / np.sqrt(lines * M * (P - 1)))
    # No distortion: its estimate scatters about zero, by about 1.2 times the noise of one realisation a line.
    scatter = M * expected * 1.2
    assert abs(np.mean(found.distortion_variance)) < 4 * scatter / np.sqrt(lines)


def test_cubic_bend_gives_the_known_gain():
    """u + c u^3 under a multisine of F lines: each line meets the others' power, gain 1 + 3 c rms^2 (1 - 1/(2F))."""
    found = bla.estimate(record(np.random.default_rng(2), 0.0, cubic, realisations=20, periods=3), N)
    ratio = found.G / truth(found)
    error = np.sqrt(np.mean(found.total_variance / np.abs(truth(found)) ** 2) / len(LINES))
    expected = 1 + 3 * BEND * RMS**2 * (1 - 1 / (2 * len(LINES)))
    assert abs(np.mean(ratio) - expected) < 4 * error
    assert error < 0.01


def test_distortion_variance_is_the_scatter_of_realisations():
    """Robust estimate from 8 noisy realisations against the scatter of 300 noise-free ones, summed over lines."""
    rng = np.random.default_rng(3)
    each = []
    for _ in range(300):
        u = np.tile(multisine(rng), 2)
        each.append(np.fft.rfft(cubic(u)[N:])[LINES] / np.fft.rfft(u[N:])[LINES])
    true = np.var(np.array(each), axis=0)
    found = bla.estimate(record(rng, 0.05, cubic, realisations=8, periods=4), N)
    # A line's variance from 8 realisations scatters by 1/sqrt(7); neighbours are not independent: 15 % of the sum.
    assert np.sum(found.distortion_variance) == pytest.approx(np.sum(true), rel=0.15)
    score = np.mean(np.abs(found.G - np.mean(each, axis=0)) ** 2 / found.total_variance)
    assert 0.8 < score < 1.9  # 7/6 expected: the variance of 8 has 7 degrees of freedom (complex)


def grid(rng):
    """Odd lines, one of every four left out at random as a detection line."""
    odd = np.arange(1, 161, 2)
    return np.sort(np.concatenate([np.delete(group, rng.integers(4)) for group in odd.reshape(-1, 4)]))


def test_fast_method_sees_odd_and_even_bends_apart():
    rng = np.random.default_rng(4)
    lines = grid(rng)
    levels = {}
    for name, system in (
        ("linear", linear),
        ("odd", cubic),
        ("even", lambda u: linear(u + 0.2 * u**2)),
    ):
        found = bla.estimate(record(rng, 0.001, system, lines, realisations=1, periods=5), N)
        assert found.method == "fast"
        odd = found.detection_lines % 2 == 1
        levels[name] = np.mean(found.detected[odd]), np.mean(found.detected[~odd]), np.mean(found.output_noise)
    for part in levels["linear"][:2]:
        assert abs(part) < 3 * levels["linear"][2]
    assert levels["odd"][0] > 300 * abs(levels["odd"][1])
    assert levels["even"][1] > 300 * abs(levels["even"][0])


def test_fast_and_robust_method_agree_on_the_distortion():
    """Mean ratio over 40 grids: one realisation on a quarter of the lines scatters by 0.7, so the mean by 0.1."""
    ratios = []
    for seed in range(40):
        rng = np.random.default_rng([5, seed])
        lines = grid(rng)
        fast = bla.estimate(record(rng, 0.01, cubic, lines, 1, 3), N)
        robust = bla.estimate(record(rng, 0.01, cubic, lines, 12, 3), N)
        ratios.append(np.mean(fast.distortion_variance) / np.mean(robust.distortion_variance))
    assert abs(np.mean(ratios) - 1.0) < 0.35


def test_parametric_fit_of_a_linear_system_is_as_good_as_its_noise_allows():
    rng = np.random.default_rng(6)
    costs, poles = [], []
    for _ in range(30):
        found = bla.estimate(record(rng, 0.1, linear, realisations=2, periods=4), N)
        model = bla.parametric(found, 2, 2, 1)
        costs.append(model.cost / model.expected)
        poles.append(max(m.s_error for m in match(model.poles, np.roots(F), 0.1)))
    # The weight is the larger of two estimated variances, which takes about a tenth off the ratio of 1.
    assert np.mean(costs) == pytest.approx(0.93, abs=0.1)
    assert np.max(poles) < 0.05


def test_noise_free_response_gives_exact_orders_and_a_wrong_order_says_so():
    data = record(np.random.default_rng(7), 0.0, linear, realisations=2, periods=3)
    found = bla.estimate(data, skip=1)  # period found by itself
    assert found.period == N
    model = bla.parametric(found, 2, 2, 1)
    np.testing.assert_allclose(model.f, F[1:], atol=1e-9)
    np.testing.assert_allclose(model.b, B[1:], atol=1e-9)
    noisy = bla.estimate(record(np.random.default_rng(7), 0.02, linear, realisations=2, periods=4), N)
    assert "suffice" in bla.parametric(noisy, 2, 2, 1).sentence
    assert "higher orders" in bla.parametric(noisy, 1, 1, 1).sentence


def test_a_start_from_the_approximation_reaches_the_optimum():
    """A polynomial Hammerstein system with a smooth bend: one start, as good as the true parameters."""
    rng = np.random.default_rng(8)
    data = record(rng, 0.02, cubic, realisations=2, periods=4)
    model = bla.parametric(bla.estimate(data, N), 2, 2, 1)
    chain = sysid.structures.hammerstein(2, 2, 1, input="polynomial")
    theta = bla_start(chain, model, data.experiments[0])
    fit = sysid.fit(chain, data.experiments[0], start=theta, starts=1)
    assert fit.stop.converged
    assert fit.criteria.loss == pytest.approx(0.02**2, rel=0.1)  # 2048 samples: a standard error of 3 %
    with pytest.raises(InputError, match="with the chain's orders"):
        bla_start(sysid.structures.hammerstein(2, 3, 1), model, data)


def test_records_that_cannot_tell():
    rng = np.random.default_rng(9)
    u = rng.normal(size=1000)
    with pytest.raises(InputError, match="does not repeat"):
        bla.estimate(IOData(u, u, 0.1))
    with pytest.raises(InputError, match="differs by up to"):
        bla.estimate(IOData(u, u, 0.1), 100)
    with pytest.raises(InputError, match="at least two more"):
        bla.estimate(IOData(np.tile(u[:400], 2), np.ones(800) * np.arange(800), 0.1), 400)
    with pytest.raises(InputError, match="missing outputs"):
        bla.estimate(IOData(np.tile(u[:200], 5), np.tile(u[:200], 5), 0.1, missing=np.arange(1000) == 3), 200)
    one = bla.estimate(record(rng, 0.1, linear, realisations=1), N)
    assert np.all(np.isnan(one.distortion_variance))
    assert "add realisations" in one.sentence

"""Spectral estimates: known plants lie within the bands, coherence as theory has it, and what is refused."""

import matplotlib as mpl
import numpy as np
import pytest
from often import often
from scipy.signal import coherence, freqz, lfilter

import sysid
from sysid import InputError, IOData
from sysid.uncertainty.spectrum import noise_spectrum

mpl.use("Agg")


def drawn(seed):
    """A record of a drawn plant with white or coloured noise, and its b and a."""
    rng = np.random.default_rng(seed)
    N, a = int(rng.integers(1500, 6000)), np.poly(rng.uniform(0.0, 0.85, int(rng.integers(1, 4))))
    b = np.append(0.0, rng.normal(size=2))
    u = rng.normal(size=N) if seed % 2 else np.repeat(rng.choice([-1.0, 1.0], N // 2 + 1), 2)[:N]
    y, e = lfilter(b, a, u), rng.normal(size=N)
    e = e if seed % 3 else lfilter([1.0], [1.0, -0.8], e)
    return IOData(u, y + e / np.std(e) * np.std(y) * 10 ** (-rng.uniform(0.0, 40.0) / 20.0), 0.1), b, a


def test_bands_hold_the_true_response_as_often_as_they_say():
    rates = []
    for seed in often(150, 50):
        data, b, a = drawn(seed)
        found = sysid.spectrum(data)
        w = found.magnitude.x
        true = freqz(b, a, w * data.Ts)[1]
        turn = np.degrees(np.angle(true / found.response))
        inside = (found.magnitude.lower <= np.abs(true)) & (np.abs(true) <= found.magnitude.upper)
        open_phase = np.abs(turn) <= found.phase.upper - found.phase.value
        below = w < 0.9 * np.pi / data.Ts
        rates.append((np.mean(inside[below]), np.mean(open_phase[below])))
    rates = np.mean(rates, axis=0)
    assert np.all((rates > 0.93) & (rates < 0.975))


def test_coherence_is_that_of_scipy_and_of_the_noise():
    rng = np.random.default_rng(1)
    u = rng.normal(size=20_000)
    y = 2.0 * u + rng.normal(size=20_000)
    found = sysid.spectrum(IOData(u, y, 0.1), samples=200)
    f, expected = coherence(u, y, 10.0, "hann", 200)
    np.testing.assert_allclose(found.magnitude.x, 2.0 * np.pi * f[1:])
    np.testing.assert_allclose(found.coherence, expected[1:], rtol=1e-9)
    assert found.coherence.mean() == pytest.approx(4.0 / 5.0, abs=0.02)
    assert found.input[1:-1].mean() == pytest.approx(0.2, rel=0.02)  # variance 1 over 5 Hz, one-sided


def test_experiments_are_averaged_and_too_little_is_refused():
    data = drawn(1)[0]
    twice = sysid.spectrum(IOData.merge(data, data), samples=100)
    once = sysid.spectrum(data, samples=100)
    np.testing.assert_allclose(twice.response, once.response, rtol=1e-9)
    assert twice.parts == pytest.approx(2.0 * once.parts, rel=0.01)
    for samples in (4, data.N):
        with pytest.raises(InputError, match=r"parts of \d+ samples leave .* independent ones"):
            sysid.spectrum(data, samples=samples)
    with pytest.raises(InputError, match="level is 95"):
        sysid.spectrum(data, level=95.0)
    with pytest.raises(InputError, match="the input is constant"):
        sysid.spectrum(IOData(np.ones(400), np.random.default_rng(0).normal(size=400), 1.0))


def test_the_figure_has_the_coherence_below():
    found = sysid.spectrum(drawn(3)[0])
    magnitude, phase, share = sysid.plots.bode(found, y_unit="rad", u_unit="V")
    np.testing.assert_allclose(magnitude.lines[0].get_ydata(), np.degrees(found.magnitude.value))
    np.testing.assert_allclose(share.lines[0].get_ydata(), found.coherence)
    assert phase.get_ylabel() == "phase [deg]"
    assert share.get_ylabel() == "coherence"


def test_the_power_of_noise_is_that_of_its_model_and_its_band_holds():
    """Over 100 records of one autoregression; its power by the formula, per Hz and one-sided."""
    a, Ts, held = [1.0, -1.2, 0.6], 0.1, []
    for seed in range(100):
        v = lfilter([1.0], a, 0.2 * np.random.default_rng([7, seed]).normal(size=2200))[200:]
        noise = noise_spectrum(v, IOData(v, v, Ts))
        H = 1.0 / np.polyval(a[::-1], np.exp(-1j * noise.x * Ts))
        power = 2.0 * Ts * 0.04 * np.abs(H) ** 2
        held.append(np.mean((noise.lower <= power) & (power <= noise.upper)))
        assert np.sum(noise.value) / (166.0 * Ts) == pytest.approx(np.var(v), rel=0.25)
    assert 0.92 < np.mean(held) < 0.97

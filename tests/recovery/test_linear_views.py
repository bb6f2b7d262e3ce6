"""Linear views of a fit against what they mean: Monte Carlo, scipy's discretisation, and noise of a known colour."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy import signal

import sysid
from sysid import linear
from sysid.linear.modes import deviation_of
from sysid.systems import system

TS = 0.1


def fitted(num, den, nk, noise=0.0, colour=(1.0,), N=600, seed=0):
    """An output-error fit of a sampled plant num/den (in z) behind nk - 1 further samples of delay."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(size=N // 3), 3)
    late = np.concatenate([np.zeros(nk - 1), u])[: len(u)]
    y = signal.lfilter(np.concatenate([[0.0] * (len(den) - len(num)), num]), den, late)
    y = y + signal.lfilter([1.0], colour, noise * rng.normal(size=len(u)))
    data = sysid.IOData(u, y, TS, "u", "y", "V", "rad")
    return sysid.fit(sysid.structures.output_error(nb=len(num), nf=len(den) - 1, nk=nk), data, search="lm", starts=1)


def sampled(b, a, Ts):
    """Numerator and denominator in z of b/a in s behind a zero-order hold."""
    num, den, _ = signal.cont2discrete((b, a), Ts, "zoh")
    return np.trim_zeros(np.where(np.abs(num[0]) < 1e-14, 0.0, num[0]), "f"), den


SECOND = ([3.0, 6.0], [1.0, 2.0, 9.0])
PLANTS = {"first": ([4.0], [1.0, 0.7]), "second": SECOND, "two lags": ([2.0], np.poly([-0.5, -4.0]))}


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("name", PLANTS)
def test_continuous_time_is_that_of_the_plant_before_it_was_sampled(name, delay):
    b, a = PLANTS[name]
    found = linear.d2c(fitted(*sampled(b, a, TS), nk=1 + delay))
    np.testing.assert_allclose(np.trim_zeros(np.round(found.G.num[0][0], 6), "f"), b, rtol=1e-4)
    np.testing.assert_allclose(found.G.den[0][0], a, rtol=1e-4)
    assert found.delay == pytest.approx(delay * TS)


@pytest.mark.parametrize("Ts", [0.05, 0.2])
def test_another_rate_is_the_plant_sampled_at_that_rate(Ts):
    found = linear.d2d(fitted(*sampled(*SECOND, TS), nk=3), Ts)
    num, den = sampled(*SECOND, Ts)
    np.testing.assert_allclose(found.num[0][0], num, rtol=1e-4)
    np.testing.assert_allclose(found.den[0][0], np.concatenate([den, np.zeros(round(0.2 / Ts))]), rtol=1e-4, atol=1e-9)
    assert found.dt == Ts


def test_the_bilinear_rule_is_undone_by_scipys():
    fit = fitted([0.4, 0.1], [1.0, -0.9, 0.5], nk=1)
    G = linear.d2c(fit, method="tustin").G
    num, den, _ = signal.cont2discrete((G.num[0][0], G.den[0][0]), TS, "bilinear")
    z = np.exp(1j * np.linspace(0.1, 30.0, 50) * TS)
    np.testing.assert_allclose(control.tf(num[0], den, TS)(z), linear.tangent(fit)(z), rtol=1e-8)


def test_a_tangent_behind_a_map_has_its_slope():
    plant = system("textbook")
    data = plant.record(500, 0.02, np.random.default_rng(1))
    fit = sysid.fit(plant.chain, data, search="lm", starts=1)
    G = linear.d2c(fit, u=0.5).G
    assert float(np.real(G(0.0))) == pytest.approx(linear.gain(fit, 0.5).value, rel=1e-6)
    np.testing.assert_allclose(np.sort_complex(np.exp(G.poles() * plant.Ts)), np.sort_complex(fit.poles), rtol=1e-6)


def test_what_has_no_continuous_form_is_refused_with_what_to_do():
    negative = fitted([1.0], [1.0, 0.6], nk=1, noise=1e-6)
    with pytest.raises(sysid.InputError, match=r'z = -0\.6.*method="tustin"'):
        linear.d2c(negative)
    more_zeros = fitted([1.0, 0.5, 0.3], [1.0, -0.6, 0.0, 0.0], nk=1, noise=1e-6)
    wide = sysid.fit(sysid.structures.output_error(nb=3, nf=1, nk=1), more_zeros.record, search="lm")
    with pytest.raises(sysid.InputError, match="pole at z = 0 that is no delay"):
        linear.d2c(wide)
    one_more = sysid.fit(sysid.structures.output_error(nb=2, nf=1, nk=1), more_zeros.record, search="lm", starts=1)
    with pytest.raises(sysid.InputError, match="pole at z = 0 that is no delay"):
        linear.d2c(one_more)
    assert np.isfinite(linear.d2c(wide, method="tustin").G(1.0))
    late = fitted(*sampled(*SECOND, TS), nk=2)
    with pytest.raises(sysid.InputError, match=r"delay of 0\.1 s is 0\.333333 samples of 0\.3 s"):
        linear.d2d(late, 0.3)
    with pytest.raises(sysid.InputError, match="unknown method 'foh'"):
        linear.d2c(late, method="foh")
    with pytest.raises(sysid.InputError, match="positive number of seconds"):
        linear.d2d(late, -1.0)


def test_deviations_are_those_of_a_monte_carlo():
    """Refits to fresh noise scatter as the deviations say: 40 refits leave a ninth of their own deviation."""
    runs = [fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.1, seed=s) for s in range(40)]
    there = [(m := fit.modes()[0]).frequency for fit in runs], [fit.modes()[0].damping for fit in runs]
    scatter = {
        "frequency": np.std(there[0], ddof=1),
        "damping": np.std(there[1], ddof=1),
        "time_constant": np.std([fit.modes()[0].time_constant for fit in runs], ddof=1),
        "gain": np.std([linear.gain(fit).value for fit in runs], ddof=1),
    }
    said = {
        "frequency": np.mean([fit.modes()[0].frequency_std for fit in runs]),
        "damping": np.mean([fit.modes()[0].damping_std for fit in runs]),
        "time_constant": np.mean([fit.modes()[0].time_constant_std for fit in runs]),
        "gain": np.mean([linear.gain(fit).std for fit in runs]),
    }
    for name, value in scatter.items():
        assert said[name] == pytest.approx(value, rel=0.3), name
    z = np.roots([1.0, -1.5, 0.7])[0]
    s = np.log(z) / TS
    assert m.frequency == pytest.approx(abs(s), rel=0.05)
    assert m.hertz == pytest.approx(abs(s) / (2 * np.pi), rel=0.05)
    assert m.damping == pytest.approx(-s.real / abs(s), rel=0.1)
    assert m.time_constant == pytest.approx(-1.0 / s.real, rel=0.1)


def test_gradients_are_those_of_parameters_drawn_from_the_covariance():
    """The delta method itself, without noise of a record: a linear map of small draws."""
    fit = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.02)
    rng = np.random.default_rng(3)
    draws = fit.theta + rng.multivariate_normal(np.zeros(len(fit.theta)), fit.covariance.cov * 1e-4, 400)
    drawn = [replace(fit, theta=theta) for theta in draws]
    for name in ("frequency", "damping", "time_constant"):
        values = [getattr(linear.modes(each)[0], name) for each in drawn]
        assert np.std(values) * 100 == pytest.approx(getattr(linear.modes(fit)[0], f"{name}_std"), rel=0.12), name
    poles = np.array([linear.modes(each)[0].pole for each in drawn])
    spread = np.hypot(np.std(poles.real), np.std(poles.imag)) * 100
    assert spread == pytest.approx(linear.modes(fit)[0].pole_std, rel=0.12)
    assert np.std([linear.gain(each).value for each in drawn]) * 100 == pytest.approx(linear.gain(fit).std, rel=0.12)
    np.testing.assert_allclose([m.pole_std for m in linear.modes(fit)], fit.pole_std, rtol=1e-9)


def test_coloured_residuals_widen_the_deviations_and_are_told():
    plain = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.1)
    coloured = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.03, colour=(1.0, -0.95), N=1500)
    wider = coloured.modes(coloured.record)[0].frequency_std / linear.modes(coloured)[0].frequency_std
    same = plain.modes(plain.record)[0].frequency_std / linear.modes(plain)[0].frequency_std
    assert same == pytest.approx(1.0, rel=0.1)
    assert not 0.9 < wider < 1.1
    noise, white = coloured.noise_model(), plain.noise_model()
    assert noise.order >= 1
    assert not noise.white
    assert max(np.abs(noise.poles)) == pytest.approx(0.95, abs=0.03)
    assert noise.variance == pytest.approx(0.03**2, rel=0.15)
    assert noise.total == pytest.approx(0.03**2 / (1 - 0.95**2), rel=0.4)
    assert "coloured" in noise.sentence()
    assert "coloured" in str(coloured)
    assert white.white
    assert "white" in str(plain)
    assert "coloured:" not in str(plain)


def test_the_noise_is_what_no_parameter_can_follow(monkeypatch):
    """The directions that the fit took out are those of the residuals' own samples."""
    fit, seen = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.05), {}
    inner = linear.noise.autoregression
    monkeypatch.setattr(linear.noise, "autoregression", lambda e, V, n: seen.update(e=e, V=V, n=n) or inner(e, V, n))
    fit.noise_model()
    V, J = seen["V"], fit.model.tangent(fit.theta, fit.record.u[:, 0])[1][fit.n_init :]
    assert sum(seen["n"]) == len(seen["e"]) == len(V) == fit.record.N - fit.n_init
    np.testing.assert_allclose(V.T @ V, np.eye(V.shape[1]), atol=1e-9)
    np.testing.assert_allclose(V @ (V.T @ J), J, atol=1e-6 * np.abs(J).max())
    fit.noise_model(fit.record[:300])
    assert seen["V"].shape[1] == 0  # of another record nothing was taken out


def test_two_coefficients_of_noise_are_found():
    fit = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.05, colour=(1.0, -1.2, 0.5), N=3000)
    A = fit.noise_model().A
    np.testing.assert_allclose(A[:3], [1.0, -1.2, 0.5], atol=0.08)
    np.testing.assert_allclose(A[3:], 0.0, atol=0.12)


def test_what_is_not_determined_has_no_deviation():
    fit = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1, noise=0.1)
    lost = np.zeros(len(fit.theta), dtype=bool)
    lost[fit.model.names.index("linear.f1")] = True
    blind = replace(fit, covariance=replace(fit.covariance, unidentifiable=lost))
    assert np.isnan(linear.modes(blind)[0].frequency_std)
    assert np.isnan(deviation_of(blind)(np.ones(len(fit.theta))))
    double = replace(fit, theta=np.array([0.3, 0.1, -1.0, 0.25, *fit.theta[4:]]))
    assert np.isnan(linear.modes(double)[0].damping_std)
    integrator = replace(fit, theta=np.array([0.3, 0.1, -1.5, 0.5, *fit.theta[4:]]))
    assert linear.gain(integrator).value == np.inf
    slow = max(linear.modes(integrator), key=lambda m: abs(m.pole))
    assert slow.time_constant > 1e6


def test_the_operating_point_lies_where_the_input_was():
    fit = fitted([0.3, 0.1], [1.0, -1.5, 0.7], nk=1)
    assert linear.gain(fit).u == 0.0
    assert linear.gain(replace(fit, u_span=(2.0, 6.0))).u == 4.0

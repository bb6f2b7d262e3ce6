"""Linear parts against scipy and control: simulation, least squares, linearisation, poles."""

import control
import numpy as np
import pytest
from scipy.signal import dlsim, lfilter

import sysid
from sysid.base.poles import match, mirrored
from sysid.estimation.starts._start import refined_iv
from sysid.linear.linearize import findop, linapp, tangent, tangent_ss
from sysid.systems import system
from sysid.workflow import evaluation


def test_transfer_function_simulates_like_scipy():
    chain = sysid.structures.output_error(2, 3, 2)
    b, f = [0.4, -0.1], [-1.9, 1.3, -0.3]
    u = np.random.default_rng(0).normal(size=500)
    theta = np.concatenate([b, f, np.zeros(3)])
    np.testing.assert_allclose(chain.simulate(theta, u), lfilter([0, 0, *b], [1, *f], u), atol=1e-10)


def test_initial_state_replays_the_middle_of_a_longer_record():
    """Any past, in free run, is an initial state: fitted on the first samples it predicts all that follow."""
    b, f = [0.4, -0.1], [-1.9, 1.3, -0.3]
    u = np.random.default_rng(1).normal(size=600)
    y = lfilter([0, *b], [1, *f], u)
    fit = sysid.fit(sysid.structures.output_error(2, 3, 1), sysid.IOData(u[:400], y[:400], 1.0))
    np.testing.assert_allclose(fit.simulate(sysid.IOData(u[400:], y[400:], 1.0)), y[400:], atol=1e-7)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_refined_iv_has_no_bias_where_least_squares_has(noise):
    """Output noise of 30 %: the equation-error estimate is far off, refined IV stays within 3 % of the poles."""
    rng = np.random.default_rng(2)
    f = np.array([-1.5, 0.7])
    u = rng.normal(size=20000)
    y0 = lfilter([0, 0.5, 0.2], [1, *f], u)
    y = y0 + noise * y0.std() * rng.normal(size=len(u))
    estimate = refined_iv(2, 2, 1, u, y)
    np.testing.assert_allclose(estimate, f, rtol=0.03 if noise else 1e-9)
    if noise:
        regressors = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2]])
        arx = np.linalg.lstsq(regressors, y[2:], rcond=None)[0][:2]
        assert np.abs(arx / f - 1).max() > 0.2


@pytest.mark.parametrize("slow", [0.9, 0.9995])
def test_an_integrator_and_a_lag_are_found_from_fast_and_slow_sampling(slow):
    """The poles of a motor, one of them on the circle, from automatic starts: 1e-6 without noise."""
    u = np.repeat(np.random.default_rng(4).normal(size=100), 100)
    y = lfilter([0, 1e-3], np.poly([1.0, slow]), u)
    fit = sysid.fit(sysid.structures.output_error(1, 2, 1), sysid.IOData(u, y, 1e-3))
    assert max(m.s_error for m in match(fit.poles, np.array([1.0, slow]), 1e-3)) < 1e-6


def test_noisy_integrator_stays_on_the_circle_and_says_so():
    """Noise pulls the free optimum outside the unit circle in about half of the seeds; the limit holds in all."""
    outside = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.normal(size=40), 20)
        y = lfilter([0, 0.01], np.poly([1.0, 0.8]), u)
        data = sysid.IOData(u, y + 0.05 * y.std() * rng.normal(size=len(u)), 0.1)
        fit = sysid.fit(sysid.structures.output_error(1, 2, 1), data, starts=1)
        assert np.abs(fit.poles).max() <= 1.0 + 1e-9
        assert fit.stop.converged
        outside += any("unit circle" in w for w in fit.warnings)
    assert outside > 0


def fitted(name="textbook"):
    plant = system(name)
    return plant, sysid.fit(plant.chain, plant.record(2000, 0.0, np.random.default_rng(1)), starts=1)


def test_tangent_is_the_derivative_of_the_free_run():
    """A small step around a steady state against control's step response of the tangent."""
    plant, fit = fitted()
    u0, h, N = 0.3, 1e-6, 60
    G = tangent(fit, u0)
    base = np.full(400 + N, u0)
    step = base.copy()
    step[400:] += h
    response = (fit.simulate(step) - fit.simulate(base))[400:] / h
    _, expected = control.step_response(G, T=np.arange(N) * plant.Ts)
    np.testing.assert_allclose(response, expected, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(np.sort_complex(G.poles()), np.sort_complex(fit.poles), atol=1e-9)
    op = findop(fit, u0)
    assert fit.simulate(base)[399] == pytest.approx(op.y, abs=1e-9)


def test_state_space_and_transfer_function_are_one_system():
    plant, fit = fitted("paper_shank")
    w = np.linspace(0.01, 3.0, 40) / plant.Ts
    G, S = tangent(fit, 0.1), tangent_ss(fit, 0.1)
    np.testing.assert_allclose(S(np.exp(1j * w * plant.Ts)), G(np.exp(1j * w * plant.Ts)), rtol=1e-8)
    assert S.nstates == 5  # as in the paper's equation (10)


def test_linapp_of_a_linear_fit_is_the_fit():
    u = np.random.default_rng(3).normal(size=1500)
    y = lfilter([0, 0.5, 0.2], [1, -1.5, 0.7], u)
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), sysid.IOData(u - u.mean(), y - y.mean(), 0.1))
    G = linapp(fit, u)
    np.testing.assert_allclose(G.den[0][0], [1, -1.5, 0.7], atol=1e-3)
    _, x = dlsim((G.num[0][0], G.den[0][0], 0.1), u)
    assert np.std(x[:, 0] - y) < 0.01 * y.std()


def test_pole_matching_pairs_the_nearest_and_measures_in_s():
    found = match(np.array([0.5, 0.905]), np.array([np.exp(-0.1), 0.5]), Ts=0.1)
    by_true = {m.true: m for m in found}
    assert by_true[0.5 + 0j].s_error == pytest.approx(0.0, abs=1e-12)
    assert by_true[complex(np.exp(-0.1))].s_error == pytest.approx(abs(np.log(0.905) / 0.1 + 1.0), rel=1e-9)


@pytest.mark.parametrize(
    ("outside", "inside"),
    [
        ([2.0, 0.5], [0.5, 0.5]),
        ([1.25 * np.exp(1j), 1.25 * np.exp(-1j), -0.3], [0.8 * np.exp(1j), 0.8 * np.exp(-1j), -0.3]),
        ([-4.0], [-0.25]),
        ([0.9, 0.2], [0.9, 0.2]),
        ([], []),
    ],
)
def test_poles_outside_the_unit_circle_are_mirrored_inside(outside, inside):
    found = mirrored(np.real(np.poly(outside))[1:] if outside else np.empty(0))
    np.testing.assert_allclose(found, np.real(np.poly(inside))[1:] if inside else [], rtol=0, atol=1e-12)


def test_a_filter_that_is_not_finite_is_none():
    np.testing.assert_array_equal(mirrored(np.array([np.nan, 1.0])), [0.0, 0.0])


@pytest.mark.parametrize(
    ("model", "lag"),
    [
        (sysid.structures.hammerstein_wiener(2, 2, 3, "cubic_spline", "polynomial"), 0.8),
        (sysid.structures.state_space(2, 2), 0.6),
    ],
    ids=["chain", "state space"],
)
def test_the_step_response_is_that_of_the_tangent_as_control_has_it(model, lag):
    """At a point of operation beside zero, where the maps have other slopes."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1.0, 2.0, 60), 10)
    y = lfilter([0, 0, 0, 1.0 - lag], [1, -lag], np.tanh(u)) + 0.001 * rng.standard_normal(len(u))
    fit = sysid.fit(model, sysid.IOData(u, y, 0.1), starts=2)
    curve = evaluation._step_response(fit, 0.7)
    t, expected = control.step_response(tangent(fit, 0.7), T=np.arange(len(curve.y)) * 0.1)
    np.testing.assert_allclose(curve.x, t, atol=1e-12)
    np.testing.assert_allclose(curve.y, np.ravel(expected), atol=1e-9 * np.abs(expected).max())

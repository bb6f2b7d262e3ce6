"""Nonlinear ARX: exact where it is linear, exact gradients, a known plant recovered, free run apart from one step."""

from dataclasses import replace

import control
import numpy as np
import pytest
from often import often

import sysid
from sysid.estimation.origin import FREE_RUN, ONE_STEP
from sysid.nlarx.choice import choices, choose_size
from sysid.nlarx.fit import fit_nlarx
from sysid.nlarx.linearize import findop, findops, tangent
from sysid.nlarx.model import Network
from sysid.nlarx.problem import Piece, PredictionProblem, SimulationProblem, rows
from sysid.nlarx.result import Choice
from sysid.nlarx.starts import empty_network, network_start
from sysid.solver.iterate import Options
from sysid.structures import nlarx


def linear_record(N, seed, noise=0.0):
    """y = 1.5 y1 - 0.7 y2 + 0.5 u1 - 0.1 u2 + 0.3, white equation noise."""
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=N), np.zeros(N)
    for t in range(2, N):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + 0.5 * u[t - 1] - 0.1 * u[t - 2] + 0.3 + noise * rng.normal()
    return sysid.IOData(u, y, 0.1)


def plant_record(N, seed, noise=0.0, steps=False):
    """A known plant with products and bends: y = 1.5 y1 - 0.7 y2 + 0.5 u1 + 0.2 u2 - 0.08 y1^2 tanh(y2) - bilinear."""
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-1, 1, N // 4), 4), np.zeros(N)
    for t in range(2, N):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + 0.5 * u[t - 1] + 0.2 * u[t - 2]
        y[t] -= 0.08 * y[t - 1] ** 2 * np.tanh(y[t - 2]) + 0.3 * u[t - 1] * y[t - 1] / (1.0 + y[t - 1] ** 2)
    return sysid.IOData(u, y + noise * y.std() * rng.normal(size=N), 0.1)


def network_at_random(focus="prediction", nonlinear=None):
    """A network of four units on the known plant's record, moved off its start."""
    data = plant_record(400, 0, 0.01)
    model = nlarx(2, 2, 1, units=4, focus=focus, nonlinear=nonlinear)
    Phi, y = rows(model, Piece.of(data))
    network, theta = network_start(empty_network(model, Phi), Phi, y)
    rng = np.random.default_rng(1)
    return data, network, theta * (1.0 + 0.02 * rng.normal(size=len(theta)))


def test_linear_data_are_recovered_exactly_and_need_no_units():
    data = linear_record(500, 0)
    fit = fit_nlarx(nlarx(2, 2, 1), data)
    assert fit.network.units == 0
    values = {p.name: p.value for p in fit.parameters}
    for name, true in {"L.y1": 1.5, "L.y2": -0.7, "L.u1": 0.5, "L.u2": -0.1}.items():
        assert values[name] == pytest.approx(true, abs=1e-9)
    assert fit.fit_percent(linear_record(500, 1)) == pytest.approx(100.0, abs=1e-6)


def test_without_units_the_fit_is_least_squares():
    data = linear_record(500, 2, 0.2)
    u, y = data.u[:, 0], data.y[:, 0]
    columns = np.column_stack([np.ones(498), y[1:-1], y[:-2], u[1:-1], u[:-2]])
    solution = np.linalg.lstsq(columns, y[2:], rcond=None)[0]
    fit = fit_nlarx(nlarx(2, 2, 1, units=0), data)
    np.testing.assert_allclose(fit.theta[1:], solution[1:], atol=1e-10)
    e = y[2:] - columns @ solution
    std = np.sqrt(e @ e / (498 - 5) * np.diag(np.linalg.inv(columns.T @ columns)))
    np.testing.assert_allclose([p.std for p in fit.parameters][1:], std[1:], rtol=1e-6)
    assert fit.residual_tests(data).white


def test_simulation_focus_without_units_is_the_output_error_model():
    """Output noise: one-step least squares is biased, the free-run optimum is not."""
    clean = linear_record(3000, 3)
    rng = np.random.default_rng(4)
    data = sysid.IOData(clean.u, clean.y + 0.3 * clean.y.std() * rng.normal(size=clean.y.shape), 0.1)
    free = fit_nlarx(nlarx(2, 2, 1, units=0, focus="simulation"), data)
    step = fit_nlarx(nlarx(2, 2, 1, units=0), data)
    assert np.abs(free.theta[1:3] - [1.5, -0.7]).max() < 0.02
    assert np.abs(step.theta[1:3] - [1.5, -0.7]).max() > 0.2
    assert (free.criteria_of, step.criteria_of) == (FREE_RUN, ONE_STEP)


def numeric_jacobian(problem, theta, h=1e-6):
    columns = []
    for i in range(len(theta)):
        e = np.zeros_like(theta)
        e[i] = h * max(1.0, abs(theta[i]))
        columns.append((problem.residual(theta - e) - problem.residual(theta + e)) / (2.0 * e[i]))
    return np.array(columns).T


@pytest.mark.parametrize("ridge", [0.0, 0.1])
@pytest.mark.parametrize("nonlinear", [None, ("y1", "u1")])
@pytest.mark.parametrize("focus", ["prediction", "simulation"])
def test_jacobian_agrees_with_finite_differences(focus, nonlinear, ridge):
    data, network, theta = network_at_random(focus, nonlinear)
    pieces = (Piece.of(data.select(0, 150))[0], Piece.of(data.select(200, 300))[0])
    problem = SimulationProblem(network, pieces, 2, ridge)
    if focus == "prediction":
        problem = PredictionProblem(network, *rows(network.model, pieces), ridge)
    e, J = problem.linearise(theta)
    np.testing.assert_allclose(e, problem.residual(theta))
    numeric = numeric_jacobian(problem, theta)
    scale = np.maximum(np.abs(J).max(axis=0), 1e-3 * np.abs(J).max())
    assert np.abs((J - numeric) / scale).max() < 1e-6


def test_slopes_at_a_point_agree_with_finite_differences():
    _, network, theta = network_at_random()
    phi, h = np.array([0.3, 0.1, -0.4, 0.2]), 1e-6
    _, slopes = network.slopes(theta, phi)
    for i in range(4):
        e = np.zeros(4)
        e[i] = h
        numeric = (network.slopes(theta, phi + e)[0] - network.slopes(theta, phi - e)[0]) / (2 * h)
        assert slopes[i] == pytest.approx(numeric, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("focus", "least"), [("prediction", 93.0), pytest.param("simulation", 95.0, marks=pytest.mark.nightly)]
)
def test_known_plant_from_automatic_starts(focus, least):
    """1 % output noise, N 2000, 12 units: noise-free validation in free run above `least` on 9 of 10 seeds."""
    reached = []
    for seed in often(20, 3):
        fit = fit_nlarx(nlarx(2, 2, 1, units=12, focus=focus), plant_record(2000, seed, 0.01), seed=seed, starts=2)
        reached.append(fit.fit_percent(plant_record(2000, 1000 + seed)))
    assert np.mean(np.array(reached) > least) >= 0.9, f"fits {np.sort(reached)}"


def test_automatic_size_beats_the_linear_model_by_far():
    estimation, validation = plant_record(400, 5, 0.01), plant_record(800, 6)
    fit = fit_nlarx(nlarx(2, 2, 1, focus="simulation"), estimation, options=Options(max_iterations=30), starts=1)
    linear = fit_nlarx(nlarx(2, 2, 1, units=0, focus="simulation"), estimation)
    assert fit.network.units >= 2
    assert {c.units for c in fit.choice} >= {0, 1, 3}
    # The error falls to less than a third.
    assert 100.0 - fit.fit_percent(validation) < (100.0 - linear.fit_percent(validation)) / 3.0


def test_a_size_is_judged_on_blocks_that_it_was_not_fitted_to():
    """Without units a network is least squares, and its error of choice that of threefold cross-validation by numpy."""
    N = 240
    rng = np.random.default_rng(15)
    u, y = rng.uniform(-1, 1, N), np.zeros(N)
    for t in range(2, N):
        y[t] = 0.6 * y[t - 1] - 0.2 * y[t - 2] + u[t - 1] ** 2 + 0.3 * u[t - 2] + 0.05 * rng.normal()
    tried = choices(nlarx(2, 2, 1, nonlinear=("u1",)), sysid.IOData(u, y, 0.1), (1e-4,), "lm")
    t = np.arange(2, N)
    X = np.column_stack([np.ones(N - 2), y[t - 1], y[t - 2], u[t - 1], u[t - 2]])
    squares = []
    for start in range(0, N, N // 3):
        held = (t >= start) & (t < start + N // 3)
        kept = (t < start) | (t >= start + N // 3 + 2)  # after the block the first two have their past in it
        law = np.linalg.lstsq(X[kept], y[t][kept], rcond=None)[0]
        squares.append(np.mean((y[t] - X @ law)[held] ** 2))
    assert tried[0].units == 0
    assert tried[0].error == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-6)


def test_a_size_whose_free_run_is_poor_is_out_however_well_it_predicts_one_step():
    tried = (Choice(0, 0.1, 0.9, 2.0), Choice(3, 0.1, 0.6, 1.1), Choice(6, 0.1, 0.5, 1.5), Choice(10, 0.1, 0.4, np.inf))
    assert choose_size(tried).units == 3
    assert choose_size(tuple(replace(c, free=np.inf) for c in tried)).units == 10  # no free run tells them apart


def test_a_free_run_that_leaves_the_data_is_told_with_its_sample_and_what_to_do():
    """A linear model fitted within +-1, run with an input ten times as large: its output leaves the range tenfold."""
    u = np.repeat(np.random.default_rng(1).uniform(-1, 1, 60), 10)
    y = np.asarray(control.forced_response(control.tf([0.2], [1, -0.8], 0.1), U=u).outputs)
    fit = fit_nlarx(nlarx(1, 1, 1, units=0), sysid.IOData(u, y, 0.1))
    loud = u * np.where(np.arange(600) < 300, 1.0, 10.0)
    told = fit.excursion(sysid.IOData(loud, y, 0.1))
    assert fit.excursion(sysid.IOData(u, y, 0.1)) is None
    assert "focus='simulation'" in told
    assert 300 <= int(told.split("from sample ")[1].split()[0]) < 320


def test_free_run_and_one_step_are_told_apart():
    data = plant_record(800, 7, 0.05)
    fit = fit_nlarx(nlarx(2, 2, 1, units=2), data, starts=1)
    free, step = fit.simulate(data), fit.predict(data)
    np.testing.assert_array_equal(free[: fit.n_init], data.y[: fit.n_init, 0])
    assert fit.prediction_percent(data) > fit.fit_percent(data) + 1.0
    # One step ahead follows a jump in the measurement at once, the free run never hears of it.
    jumped = data.y.copy()
    jumped[400] += 1.0
    other = sysid.IOData(data.u, jumped, data.Ts)
    np.testing.assert_array_equal(fit.simulate(other), free)
    assert np.abs(fit.predict(other) - step)[401] > 0.1
    assert fit.summary()["criteria_of"] == ONE_STEP
    np.testing.assert_allclose(fit.criteria.loss, np.mean(fit.residuals(data) ** 2))
    assert fit.criteria.mse == fit.criteria.loss


def test_free_run_is_the_recursion_written_out():
    data, network, theta = network_at_random()
    first, u, y = 3, data.u[:40, 0], data.y[:40, 0]
    yhat, _, end = network.free_run(theta, u, y, first, 1e9)
    expected = y.copy()
    for t in range(first, 40):
        phi = np.array([expected[t - 1], expected[t - 2], u[t - 1], u[t - 2]])
        expected[t] = network.slopes(theta, phi)[0]
    assert end == 40
    np.testing.assert_allclose(yhat, expected, rtol=1e-12)


def test_equal_seeds_give_equal_numbers_and_experiments_keep_their_own_start():
    record = plant_record(800, 8, 0.01)
    parts = sysid.IOData.merge(record.select(0, 350), record.select(400, 800))
    model = nlarx(2, 2, 1, units=3, focus="simulation")
    one, two = (fit_nlarx(model, parts, seed=3, options=Options(max_iterations=20)) for _ in range(2))
    np.testing.assert_array_equal(one.theta, two.theta)
    assert one.criteria.N == 800 - 50 - 2 * 2
    yhat = one.simulate(parts)
    np.testing.assert_array_equal(yhat[350:352], record.y[400:402, 0])
    assert one.fit_percent(parts) > 85.0


def test_missing_samples_do_not_count():
    record = linear_record(400, 9)
    y, lost = record.y.copy(), np.zeros(400, dtype=bool)
    lost[100:140:7] = True
    y[lost] = np.nan
    data = sysid.IOData(record.u, y, record.Ts, missing=lost)
    fit = fit_nlarx(nlarx(2, 2, 1, units=0), data)
    np.testing.assert_allclose(fit.theta[1:], [1.5, -0.7, 0.5, -0.1], atol=1e-9)
    used = fit.criteria.N  # a lost sample takes itself and the two that it feeds along
    assert used == 398 - 3 * int(lost.sum())


def test_a_diverging_free_run_is_minus_infinity_and_a_sentence():
    """An unstable plant held by feedback: the one-step model is right, and its free run leaves the earth."""
    rng = np.random.default_rng(10)
    u, y = np.zeros(3000), np.zeros(3000)
    for t in range(1, 3000):
        y[t] = 1.1 * y[t - 1] + u[t - 1] + 0.01 * rng.normal()
        u[t] = -0.3 * y[t] + 0.1 * rng.normal()
    data = sysid.IOData(u, y, 1.0)
    fit = fit_nlarx(nlarx(1, 1, 1, units=0), data)
    assert fit.theta[1] == pytest.approx(1.1, abs=0.01)
    assert fit.fit_percent(data) == -np.inf
    assert not np.isnan(fit.simulate(data)).any()
    assert fit.prediction_percent(data) > 80.0
    assert any("on the estimation record the free run diverges" in w for w in fit.warnings)
    assert "focus='simulation'" in fit.divergence(data)
    assert fit.divergence(data.select(0, 10)) is None


def test_tangent_of_a_linear_model_is_that_model_at_every_point():
    fit = fit_nlarx(nlarx(2, 2, 1), linear_record(500, 11))
    expected = control.tf([0.5, -0.1], [1.0, -1.5, 0.7], 0.1)
    w = np.array([0.3, 1.0, 10.0, 30.0])
    for u in (-1.0, 2.0):
        G = tangent(fit, u)
        np.testing.assert_allclose(G(np.exp(1j * w * 0.1)), expected(np.exp(1j * w * 0.1)), rtol=1e-6)
        assert findop(fit, u).y == pytest.approx((0.4 * u + 0.3) / 0.2, rel=1e-6)


def test_tangent_predicts_a_small_step_of_the_free_run():
    fit = fit_nlarx(nlarx(2, 2, 1, units=5, focus="simulation"), plant_record(1500, 12, 0.01), starts=1)
    op = findop(fit, 0.3)
    base = np.concatenate([np.full(20, 0.3), np.full(60, 0.3 + 1e-4)])
    start = sysid.IOData(base, np.full(80, op.y), 0.1)
    moved = fit.simulate(start, 20)[20:] - op.y
    response = control.forced_response(tangent(fit, 0.3), np.arange(60) * 0.1, np.full(60, 1e-4)).outputs
    np.testing.assert_allclose(moved, response, atol=1e-3 * np.abs(response).max())


def test_an_integrator_has_no_steady_state():
    rng = np.random.default_rng(13)
    u = rng.normal(size=400)
    data = sysid.IOData(u, np.concatenate([[0.0], np.cumsum(u)[:-1]]), 1.0)
    fit = fit_nlarx(nlarx(1, 1, 1), data)
    with pytest.raises(sysid.InputError, match="no steady state at u = 1"):
        findop(fit, 1.0)
    assert findops(fit, 1.0) == ()


def test_names_of_parameters_follow_the_lags():
    network = Network(nlarx(1, 2, 2, units=1), np.zeros(3), np.zeros((2, 3)), wavelets=1)
    assert network.names == ("y0", "L.y1", "L.u2", "L.u3", "wavelet1.s", "wavelet1.b", "wavelet1.c1", "wavelet1.c2")
    assert network.model.lag == 3


def test_bad_input_is_refused_in_a_sentence():
    data = linear_record(100, 14)
    with pytest.raises(sysid.InputError, match="na, nb, nk"):
        nlarx(-1, 2, 1)
    with pytest.raises(sysid.InputError, match="'auto'"):
        nlarx(units="many")
    with pytest.raises(sysid.InputError, match="prediction, simulation"):
        nlarx(focus="both")
    with pytest.raises(sysid.InputError, match="y1, y2, u1, u2"):
        nlarx(nonlinear=("y3",))
    with pytest.raises(sysid.InputError, match="too few for 65 parameters"):
        fit_nlarx(nlarx(units=10), data.select(0, 60))
    with pytest.raises(sysid.InputError, match="too short for lags of 40"):
        fit_nlarx(nlarx(na=40), data.select(0, 30))
    with pytest.raises(sysid.InputError, match="output is constant"):
        fit_nlarx(nlarx(), sysid.IOData(data.u, np.ones(100), 0.1))
    with pytest.raises(sysid.InputError, match="one of each"):
        fit_nlarx(nlarx(), sysid.IOData(np.column_stack([data.u, data.u]), data.y, 0.1))
    with pytest.raises(sysid.InputError, match="gna, gradient, lm"):
        fit_nlarx(nlarx(), data, search="newton")
    with pytest.raises(sysid.InputError, match="starts is 0"):
        fit_nlarx(nlarx(), data, starts=0)
    fit = fit_nlarx(nlarx(units=0), data)
    with pytest.raises(sysid.InputError, match="resample"):
        fit.simulate(sysid.IOData(data.u, data.y, 0.5))
    with pytest.raises(sysid.InputError, match="give a longer one"):
        fit.fit_percent(data.select(0, 30), n_init=29)


def test_a_size_that_another_ridge_puts_out_leaves_the_choice_to_a_smaller_one(monkeypatch):
    """With 3 units under the second ridge the run is so much better that the first ridge's 3 units are out."""
    scripted = {(0, 1e-2): (1.0, 1.0), (1, 1e-2): (1.0, 1.0), (3, 1e-2): (0.5, 1.15), (3, 1e-4): (1.0, 0.9)}
    found = []

    def errors(self, units, ridge):
        found.append((units, ridge))
        step, free = scripted.get((units, ridge), (1.5, 1.5))
        return step**2, free**2

    monkeypatch.setattr("sysid.nlarx.choice._Judge.errors", errors)
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, 300)
    y = np.tanh(np.convolve(u, [0.0, 0.5, 0.3])[:300]) + 0.1 * rng.standard_normal(300)
    model = nlarx(1, 1, 1, focus="prediction")
    tried = choices(model, sysid.IOData(u, y, 0.1), (1e-2, 1e-4, 0.1), "lm")
    assert choose_size(tried).units == 0
    assert found[-1] == (0, 0.1)  # which the last ridge is tried with

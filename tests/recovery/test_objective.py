"""Several experiments, several channels, missing samples, outliers, prior knowledge: each against a known truth."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import ndtri

import sysid
from sysid.base.poles import match
from sysid.estimation.objective import huber, spread
from sysid.estimation.prior import Prior
from sysid.estimation.problem import ChainProblem
from sysid.solver.iterate import Options
from sysid.structures import hammerstein_wiener
from sysid.systems import system

Objective, IOData = sysid.Objective, sysid.IOData


def lag(u, pole=0.9, gain=0.5, past=0.0):
    """y_t = pole y_{t-1} + gain u_{t-1} from the output `past` on."""
    return lfilter([0, gain], [1, -pole], u, zi=[past])[0]


def first_order():
    return sysid.structures.output_error(1, 1, 1)


def test_experiments_with_states_of_their_own_give_the_exact_model():
    """Three short runs that start from far apart: together exact, glued into one record not."""
    rng = np.random.default_rng(0)
    pieces = []
    for past in (0.0, 5.0, -8.0):
        u = rng.normal(size=80)
        pieces.append(IOData(u, lag(u, past=past), 1.0))
    fit = sysid.fit(first_order(), IOData.merge(*pieces))
    np.testing.assert_allclose(fit.poles, [0.9], atol=1e-9)
    assert fit.criteria.d == 1 + 1 + 3  # b, f and three initial states
    np.testing.assert_allclose(
        fit.simulate(IOData.merge(*pieces)), np.concatenate([p.y for p in pieces])[:, 0], atol=1e-6
    )
    glued = IOData(np.concatenate([p.u for p in pieces]), np.concatenate([p.y for p in pieces]), 1.0)
    assert abs(sysid.fit(first_order(), glued).poles[0] - 0.9) > 1e-3


def test_missing_samples_do_not_count_whatever_stands_there():
    rng = np.random.default_rng(1)
    u = rng.normal(size=500)
    y = lag(u) + 0.01 * rng.normal(size=500)
    lost = rng.uniform(size=500) < 0.2
    spoiled = np.where(lost, np.nan, y)
    fit = sysid.fit(first_order(), IOData(u, spoiled, 1.0, missing=lost))
    other = sysid.fit(first_order(), IOData(u, np.where(lost, 1e3, y), 1.0, missing=lost))
    np.testing.assert_array_equal(fit.theta, other.theta)
    assert 500 - lost.sum() == fit.criteria.N
    assert abs(fit.poles[0] - 0.9) < 4 * fit.pole_std[0]
    with pytest.raises(sysid.InputError, match="mark outputs as missing"):
        IOData(u, spoiled, 1.0)


def test_huber_holds_against_outliers_that_squares_follow(seeds):
    """5 % of samples off by 20 times the output: Huber's loss keeps the pole within 1 %, least squares does not."""
    huber, squares = [], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        u = rng.normal(size=600)
        y = lag(u)
        y = y + 0.02 * y.std() * rng.normal(size=600)
        hit = rng.uniform(size=600) < 0.05
        y[hit] += 20 * y.std() * rng.choice([-1, 1], hit.sum())
        data = IOData(u, y, 1.0)
        huber.append(
            abs(sysid.fit(first_order(), data, starts=1, objective=Objective(huber_threshold=1.345)).poles[0] - 0.9)
        )
        squares.append(abs(sysid.fit(first_order(), data, starts=1).poles[0] - 0.9))
    assert max(huber) < 0.009
    assert np.median(squares) > 5 * np.median(huber)


def test_ridge_ends_at_the_nominal_point_and_starts_at_least_squares():
    rng = np.random.default_rng(2)
    u = rng.normal(size=300)
    data = IOData(u, lag(u) + 0.05 * rng.normal(size=300), 1.0)
    nominal = {"linear.b0": 0.7, "linear.f1": -0.5}
    free = sysid.fit(first_order(), data)
    weak = sysid.fit(first_order(), data, objective=Objective(ridge=1e-9, nominal=nominal))
    strong = sysid.fit(first_order(), data, objective=Objective(ridge=1e12, nominal=nominal))
    np.testing.assert_allclose(weak.theta[:2], free.theta[:2], atol=1e-5)
    np.testing.assert_allclose(strong.theta[:2], [0.7, -0.5], atol=1e-5)
    with pytest.raises(sysid.InputError, match=r"linear\.b0"):
        sysid.fit(first_order(), data, objective=Objective(ridge=1.0, nominal={"b0": 1.0}))


PRIOR = Prior(np.random.default_rng(8).normal(size=(5, 16)), np.arange(5.0), np.array([0.3, 0.1, 1.0, 2.0, 0.0]))


@pytest.mark.parametrize(
    "on_top",
    [
        {},
        {"huber_threshold": 0.1},
        {"prior": PRIOR},
        {"weights": np.array([3.0])},
        {"curvature_weight": 2.0},
        {"huber_threshold": 0.1, "prior": PRIOR, "weights": np.array([3.0]), "curvature_weight": 2.0},
    ],
    ids=["squares", "huber", "prior", "weights", "curvature", "all"],
)
def test_problem_jacobian_agrees_with_finite_differences(on_top):
    """What can stand around the free run, alone and at once: three experiments, gaps, Huber, a prior, weights and
    curvature."""
    rng = np.random.default_rng(3)
    plant = system("textbook")
    a, b, c = (plant.record(N, 0.1, rng) for N in (200, 150, 120))
    b = IOData(b.u, b.y, b.Ts, missing=rng.uniform(size=150) < 0.3)
    start = np.array([plant.theta, plant.theta, plant.theta])
    problem = ChainProblem(plant.chain, start, (a, b, c), plant.chain.free, **on_top)
    p = 0.01 * rng.normal(size=len(problem.start))
    e, J = problem.linearise(p)
    np.testing.assert_array_equal(e, problem.residual(p))
    samples = 200 + int(b.observed.sum()) + 120
    # Five rows of the prior, and two kinks of a map of four knots.
    assert len(e) == samples + 5 * ("prior" in on_top) + 2 * ("curvature_weight" in on_top)
    h = 1e-6
    for i in range(len(p)):
        step = np.zeros_like(p)
        step[i] = h
        numeric = (problem.residual(p - step) - problem.residual(p + step)) / (2 * h)
        off = np.abs(J[:, i] - numeric)
        # Quantile over samples: one within h of a kink has no two-sided derivative. What is put on top has no kinks.
        assert np.quantile(off[:samples], 0.98) < 1e-6 * max(1.0, np.abs(J).max())
        np.testing.assert_allclose(off[samples:], 0.0, atol=1e-6 * max(1.0, np.abs(J[samples:]).max(initial=0.0)))


def test_two_inputs_and_two_outputs():
    """A 2 x 2 plant with a saturating second input and a bent first output; every pole from automatic starts."""
    rng = np.random.default_rng(4)
    N = 3000
    u = np.repeat(rng.uniform(-2, 2, (N // 5, 2)), 5, axis=0)
    w = np.column_stack([u[:, 0], np.clip(u[:, 1], -1.0, 1.2)])

    def through(b, f, x):
        return lfilter([0, b], [1, f], x)

    x1 = through(0.5, -0.7, w[:, 0]) + through(0.3, -0.9, w[:, 1])
    x2 = through(-0.2, -0.8, w[:, 0]) + through(0.6, -0.5, w[:, 1])
    y = np.column_stack([np.where(x1 > 0, x1, 0.5 * x1), x2])
    y = y + 0.005 * y.std(axis=0) * rng.normal(size=y.shape)
    chain = sysid.structures.hammerstein_wiener(
        1, 1, 1, input=["unit_gain", "saturation"], output=["piecewise_linear", "unit_gain"], nu=2, ny=2
    )
    data = IOData(u, y, 0.1)
    fit = sysid.fit(chain, data.select(0, 2000))
    assert np.all(fit.fit_percents(data.select(2000, N)) > 99.3)  # 99.5 is what the noise leaves
    np.testing.assert_allclose(fit.poles, [0.7, 0.9, 0.8, 0.5], atol=0.01)
    with pytest.raises(sysid.InputError, match=r"1 input\(s\)"):
        fit.fit_percent(IOData(u[:, 0], y[:, 0], 0.1))


def test_output_weights_choose_which_output_a_shared_map_serves():
    """One input saturation cannot be at 1 for one output and at 1.5 for the other; the heavier output gets its way."""
    rng = np.random.default_rng(5)
    u = rng.uniform(-2, 2, 2000)
    y = np.column_stack([lag(np.clip(u, -1, 1), 0.5), lag(np.clip(u, -1.5, 1.5), 0.5)])
    chain = sysid.structures.hammerstein(1, 1, 1, input=["saturation"], nu=1, ny=2)
    data = IOData(u, y, 1.0)
    first, second = (sysid.fit(chain, data, objective=Objective(weights=w)) for w in ((30.0, 1.0), (1.0, 30.0)))
    assert first.theta[1] == pytest.approx(1.0, abs=0.02)
    assert second.theta[1] == pytest.approx(1.5, abs=0.02)
    with pytest.raises(sysid.InputError, match="one for each"):
        sysid.fit(chain, data, objective=Objective(weights=(1.0,)))


def test_wiener_hammerstein_poles_are_dealt_to_the_right_filter():
    """0.9 stands before the bend and 0.5 +- 0.4i after it; only one deal of the poles fits the data."""
    rng = np.random.default_rng(6)
    u = np.repeat(rng.uniform(-2, 2, 1000), 4)
    x = lfilter([0, 0.1], [1, -0.9], u)
    z = np.where(x > 0.2, 2.0 * x - 0.2, x)
    y = lfilter([0.4, 0.2], np.real(np.poly([0.5 + 0.4j, 0.5 - 0.4j])), z)
    data = IOData(u, y + 0.005 * y.std() * rng.normal(size=len(u)), 0.1)
    chain = sysid.structures.wiener_hammerstein(1, 1, 1, nb2=2, nf2=2)
    fit = sysid.fit(chain, data.select(0, 3000))
    assert fit.fit_percent(data.select(3000, 4000)) > 99.2
    found = match(fit.poles, np.array([0.9, 0.5 + 0.4j, 0.5 - 0.4j]), 0.1)
    assert max(m.s_error for m in found) < 0.02
    np.testing.assert_allclose(fit.poles[0], 0.9, atol=0.005)


OBJECTIVES = {
    "weights": (Objective(weights=(10.0,)), 100.0),
    "huber": (Objective(huber_threshold=1.0), None),
    "ridge and curvature": (Objective(ridge=1e-3, curvature_weight=5.0), 1.0),
}


@pytest.mark.parametrize("name", sorted(OBJECTIVES))
def test_mse_is_of_the_errors_as_they_are_whatever_was_minimised(name):
    """Against the free run worked out beside the fit; the loss keeps the factor of the weights, which is known."""
    rng = np.random.default_rng(8)
    u = rng.uniform(-2, 2, 400)
    y = lag(np.clip(u, -1, 1)) + 0.05 * rng.standard_t(2, size=400)
    lost = np.isin(np.arange(400), [50, 51, 300])
    chain = sysid.structures.hammerstein(1, 1, 1, input="piecewise_linear")
    objective, factor = OBJECTIVES[name]
    fit = sysid.fit(chain, IOData(u, np.where(lost, np.nan, y), 1.0, missing=lost), starts=1, objective=objective)
    errors = (y - fit.model.simulate(fit.theta, u))[~lost]
    V, N, d = np.mean(errors**2), 397, fit.criteria.d
    assert fit.criteria.mse == pytest.approx(V, rel=1e-12)
    assert fit.criteria.fpe == pytest.approx(V * (N + d) / (N - d), rel=1e-12)
    if factor is None:
        assert fit.criteria.loss < 0.8 * V  # heavy tails cost less than their squares
    else:
        assert fit.criteria.loss == pytest.approx(factor * V, rel=1e-12)


def test_weights_of_several_outputs_are_not_in_the_mse():
    rng = np.random.default_rng(9)
    u = rng.normal(size=300)
    y = np.column_stack([lag(u), 2 * lag(u)]) + [0.1, 0.01] * rng.normal(size=(300, 2))
    chain = sysid.structures.output_error(1, 1, 1, nu=1, ny=2)
    fit = sysid.fit(chain, IOData(u, y, 1.0), starts=1, objective=Objective(weights=(1.0, 10.0)))
    errors = y - chain.outputs(fit.theta, u)
    assert fit.criteria.mse == pytest.approx(np.mean(errors**2), rel=1e-12)
    assert fit.criteria.loss == pytest.approx(np.mean((errors * [1.0, 10.0]) ** 2), rel=1e-12)


def test_hubers_loss_by_hand_and_its_slope():
    """Threshold 2: e^2 up to it, 4 |e| - 4 beyond, without a jump, and the derivative of the root that is squared."""
    e = np.array([-5.0, -2.0, -1.0, 0.0, 0.5, 2.0, 3.0])
    r, slope = huber(e, 2.0)
    np.testing.assert_allclose(r**2, [16.0, 4.0, 1.0, 0.0, 0.25, 4.0, 8.0])
    np.testing.assert_array_equal(np.sign(r), np.sign(e))
    h = 1e-6
    inside = np.abs(e) != 2.0
    numeric = (huber(e + h, 2.0)[0] - huber(e - h, 2.0)[0]) / (2 * h)
    np.testing.assert_allclose(slope[inside], numeric[inside], atol=1e-8)


def test_the_spread_of_gaussian_errors_is_their_standard_deviation():
    """Of exact quantiles, and blind to a tenth of outliers where these lie on both sides."""
    e = 3.0 * ndtri((np.arange(10_000) + 0.5) / 10_000) + 7.0
    assert spread(e) == pytest.approx(3.0, rel=1e-3)
    assert spread(np.concatenate([e, np.full(500, 1e6), np.full(500, -1e6)])) == pytest.approx(3.0, rel=0.15)


def test_a_fit_ends_after_its_seconds_with_the_best_so_far():
    """10,000 samples: the limit passes within the first iterations, and the fit is what they reached."""
    plant = system("textbook")
    data = plant.record(10_000, 0.01, np.random.default_rng(3))
    model = hammerstein_wiener(2, 2, 1)
    short = sysid.fit(model, data, starts=1, options=Options(max_seconds=1e-3))
    assert "limit of 0.001 s reached" in short.stop.reason
    assert not short.stop.converged
    assert short.stop.iterations == 0
    free = sysid.fit(model, data, starts=1, options=Options(max_seconds=3600.0))
    assert "limit of" not in free.stop.reason
    assert free.criteria.loss < short.criteria.loss
    small = sysid.fit(
        sysid.structures.nlarx(focus="simulation"), data.select(0, 400), options=Options(max_seconds=1e-3)
    )
    assert "limit of 0.001 s reached" in small.stop.reason

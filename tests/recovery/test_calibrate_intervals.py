"""What records tell, and intervals under departures, on linear problems whose answers are known."""

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from sysid.base.parallel import one_blas_thread
from twin.calibrate.discrepancy import Frame, covariance, departures, directions, drifting, estimate, repeating, sizes
from twin.calibrate.identifiability import LIMIT, promised_covariance, tell
from twin.calibrate.problem import Free, Record, Simulations

TS, N = 0.05, 1600
T = np.arange(N) * TS


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Small matrices, thousands of times: beside another worker, threads of BLAS mostly wait for each other."""
    with one_blas_thread():
        yield


def sweep():
    """A joint that goes to and fro between two ends and rests there, at three speeds."""
    legs, y = (0.2, 0.35, 0.5), [0.0]
    speed, way = legs[0], 1.0
    for k in range(N - 1):
        if k % 160 == 0:
            way, speed = -way, legs[(k // 160) % 3]
        y.append(float(np.clip(y[-1] + way * speed * TS, -1.0, 1.0)))
    return np.array(y)


Y = sweep()
FRAME = Frame.of([Y], [TS])


def linear(columns, truth, noise, extra=0.0, seed=0, names="abcdef", scale=1.0):
    """The response Y + columns theta, measured with noise and something else."""
    rng = np.random.default_rng(seed)
    y = Y + columns @ truth + extra + noise * rng.standard_normal(N)
    free = [Free(names[j], 0.0, -50.0, 50.0, "1", scale) for j in range(columns.shape[1])]
    return Simulations(free, [Record("r", y, TS, lambda values: Y + values @ columns.T)], noise)


def test_the_promised_deviation_is_the_closed_form():
    # dy/da = 1: the deviation of a mean of N samples is noise / sqrt(N).
    task = linear(np.ones((N, 1)), [0.0], 0.1)
    _, J = task.linearise(task.start)
    (row,) = tell(task, J, 0.1, ["a"])
    assert row.expected == pytest.approx(0.1 / np.sqrt(N), rel=1e-6)
    assert row.told


def test_parameters_that_act_alike_are_named_and_the_later_one_is_fixed():
    columns = np.column_stack([Y, Y * (1.0 + 1e-4 * np.sin(T)), np.ones(N)])
    task = linear(columns, [0.0] * 3, 0.1)
    _, J = task.linearise(task.start)
    for order, kept in ((["a", "b", "c"], "a"), (["b", "a", "c"], "b")):
        told = {row.name: row for row in tell(task, J, 0.1, order)}
        (lost,) = [name for name, row in told.items() if not row.told]
        assert {lost, kept} == {"a", "b"}
        assert told[lost].alike == (kept,)
        assert f"{lost} and {kept} act alike" in told[lost].sentence()


def test_a_parameter_without_effect_is_not_told():
    task = linear(np.column_stack([Y, np.zeros(N)]), [0.0, 0.0], 0.1)
    _, J = task.linearise(task.start)
    told = tell(task, J, 0.1, ["a", "b"])
    assert [row.told for row in told] == [True, False]
    assert "hardly show b" in told[1].sentence()
    assert np.isinf(promised_covariance(J, 0.1)[1, 1])


def test_the_limit_is_a_share_of_the_scale():
    # The deviation 0.1 / sqrt(N) is just below or just above the limit.
    for factor, told in ((1.02, True), (0.98, False)):
        task = linear(np.ones((N, 1)), [0.0], 0.1, scale=factor * 0.1 / np.sqrt(N) / LIMIT)
        _, J = task.linearise(task.start)
        assert tell(task, J, 0.1, ["a"])[0].told is told


def test_directions_of_a_joint_that_rests():
    # Central differences: a sample beside a motion counts as moving. The rest keeps the direction before it.
    way, moves = directions(np.array([0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 1.0, 0.0, 0.0, 0.0]), 1.0)
    assert np.flatnonzero(~moves).tolist() == [0, 1, 5, 6, 10, 11]
    assert way.tolist() == [1.0] * 7 + [-1.0] * 5


def test_sizes_of_departures_are_found():
    """A random function of the place of size 0.3 beside white noise of 0.1: both come back, and no drift is seen."""
    J = np.column_stack([np.ones(N), Y, T])
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        groups = departures([Y], [TS], 0.12, FRAME)
        e = 0.1 * rng.standard_normal(N) + groups[0] @ (0.3 * rng.standard_normal(groups[0].shape[1]))
        size = sizes(e - J @ np.linalg.lstsq(J, e)[0], J, groups)
        found.append((size.noise, *size.groups))
    noise, place, _, _, _ = np.array(found).T
    assert np.median(noise) == pytest.approx(0.1, rel=0.03)
    assert np.median(place) == pytest.approx(0.3, rel=0.2)
    # The same place read upwards and downwards agrees: what depends on the direction too is small beside it.
    assert np.median(np.array(found)[:, 2]) < 0.05


@pytest.mark.parametrize("extra", [pytest.param("place", marks=pytest.mark.nightly), "speed", "none"])
def test_intervals_hold_under_departures(extra, seeds):
    """Of a dozen estimates of three parameters, about 95 % lie within 1.96 deviations, whatever departs."""
    J = np.column_stack([np.ones(N), Y, np.gradient(Y, TS)])
    G, inside, white = np.linalg.pinv(J), [], []
    places = repeating([Y], [TS], 0.12, FRAME)[0]
    speeds = drifting([Y], [TS], 0.12, FRAME)[0]
    for seed in seeds:
        rng = np.random.default_rng(seed)
        e = 0.05 * rng.standard_normal(N)
        if extra == "place":
            e += places @ (0.2 * rng.standard_normal(places.shape[1]))
        if extra == "speed":
            e += speeds @ (0.05 * rng.standard_normal(speeds.shape[1]))
        estimate_ = G @ e
        left = e - J @ estimate_
        groups, size = estimate(left, J, [Y], [TS], np.ones(N, dtype=bool))
        std = np.sqrt(np.diag(covariance(J, groups, size)))
        inside.append(np.abs(estimate_) < 1.96 * std)
        white.append(np.abs(estimate_) < 1.96 * np.sqrt(np.mean(left**2) * np.diag(G @ G.T)))
    assert 0.88 <= np.mean(inside) <= 1.0
    assert extra == "none" or np.mean(white) < 0.7  # what intervals from white residuals would hold


def test_sizes_are_those_of_the_likelihood_outside_the_span_of_the_jacobian():
    """Beside scipy's normal density of the contrasts of e, maximised without derivatives."""
    rng = np.random.default_rng(8)
    J, groups = rng.standard_normal((60, 3)), [rng.standard_normal((60, k)) for k in (4, 7)]
    e = J @ [1.0, 2.0, 3.0] + groups[0] @ rng.normal(0.0, 0.5, 4) + rng.normal(0.0, 0.2, 60)
    contrasts = null_space(J.T)

    def loss(logs):
        noise, *stds = np.exp(logs)
        covariance = noise**2 * np.eye(60) + sum(s**2 * g @ g.T for s, g in zip(stds, groups, strict=True))
        return -multivariate_normal.logpdf(contrasts.T @ e, cov=contrasts.T @ covariance @ contrasts)

    best = minimize(loss, np.log([0.3, 0.3, 0.05]), method="Nelder-Mead", options={"maxiter": 2000, "xatol": 1e-6})
    found = sizes(e, J, groups)
    assert found.noise == pytest.approx(np.exp(best.x[0]), rel=1e-3)
    assert found.groups[0] == pytest.approx(np.exp(best.x[1]), rel=1e-3)
    constant = 0.5 * contrasts.shape[1] * np.log(2.0 * np.pi)
    assert found.likelihood - constant == pytest.approx(-best.fun, abs=1e-3)

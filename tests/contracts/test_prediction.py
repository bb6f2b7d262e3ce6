"""Prediction k samples ahead, against recursions that are written out here a second time, sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

import sysid
from sysid import InputError, IOData
from sysid.data.preprocess import quick_start
from sysid.estimation.free_run import autoregression, forecast


def coloured(N=600, seed=0):
    """A lag under a held input, whose output carries noise of a second autoregression."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, N // 10), 10)
    y, v = np.zeros(N), np.zeros(N)
    for t in range(2, N):
        y[t] = 0.9 * y[t - 1] + 0.3 * u[t - 1]
        v[t] = 1.4 * v[t - 1] - 0.5 * v[t - 2] + 0.05 * rng.standard_normal()
    return IOData(u + 3.0, y + v + 20.0, 0.1)


ESTIMATION, VALIDATION = quick_start(coloured())


@pytest.fixture(scope="module")
def chain():
    return sysid.fit(sysid.structures.output_error(1, 1, 1), ESTIMATION, starts=1)


@pytest.fixture(scope="module")
def network():
    return sysid.fit(sysid.structures.nlarx(2, 2, 1, units=2), ESTIMATION, starts=1)


def test_the_autoregression_is_that_of_the_noise():
    rng = np.random.default_rng(1)
    v = np.zeros(20000)
    for t in range(2, len(v)):
        v[t] = 1.4 * v[t - 1] - 0.5 * v[t - 2] + rng.standard_normal()
    found = autoregression(v, (len(v),))
    np.testing.assert_allclose(found[:2], [1.4, -0.5], atol=0.03)
    np.testing.assert_allclose(found[2:], 0.0, atol=0.03)
    assert autoregression(rng.standard_normal(5000), (2500, 2500))[:1] in ((), pytest.approx((0.0,), abs=0.05))
    assert autoregression(1e-14 * v, (len(v),), size=1.0) == ()


@pytest.mark.parametrize("horizon", [1, 2, 5])
def test_a_chain_predicts_by_its_free_run_and_the_forecast_of_its_residuals(chain, horizon):
    """v(t | t-k): the autoregression runs on from the residuals up to t - k, one sample after the other."""
    (a,) = chain.noise
    run, y = chain.simulate(VALIDATION), VALIDATION.y[:, 0]
    assert len(a) >= 2
    expected = run.copy()
    for t in range(VALIDATION.N):
        known = (y - run)[: max(t - horizon + 1, 0)].tolist()
        while known and len(known) <= t:
            known.append(sum(c * known[-i] for i, c in enumerate(a, 1) if i <= len(known)))
        expected[t] += known[t] if known else 0.0
    np.testing.assert_allclose(chain.predict(VALIDATION, horizon), expected, atol=1e-12)


@pytest.mark.parametrize("horizon", [1, 2, 3, 7])
def test_a_network_predicts_from_what_was_measured_before(network, horizon):
    run = replace(network, u_offset=None, y_offset=None)
    u, y, lag = VALIDATION.u[:, 0], VALIDATION.y[:, 0], network.model.lag
    expected = y.copy()
    for t in range(lag, VALIDATION.N):
        first = max(t - horizon + 1, lag)
        past = y.copy()
        for k in range(first, t + 1):
            phi = np.array([past[k - 1], past[k - 2], u[k - 1], u[k - 2]])
            past[k] = run.network.predict(run.theta, phi[None])[0][0]
        expected[t] = past[t]
    np.testing.assert_allclose(network.predict(VALIDATION, horizon), expected, atol=1e-10)


def test_a_farther_horizon_ends_in_the_free_run(chain, network):
    n = network.n_init
    np.testing.assert_allclose(chain.predict(VALIDATION, 500), chain.simulate(VALIDATION), atol=1e-9)
    np.testing.assert_allclose(network.predict(VALIDATION, VALIDATION.N), network.simulate(VALIDATION, n), atol=1e-9)


def test_prediction_helps_under_coloured_noise_and_the_nearer_the_more(chain):
    y, n = VALIDATION.y[:, 0], chain.n_init
    errors = [np.std((y - chain.predict(VALIDATION, k))[n:]) for k in (1, 3, 10)]
    assert errors[0] < errors[1] < errors[2] <= 1.02 * np.std((y - chain.simulate(VALIDATION))[n:])
    assert errors[0] == pytest.approx(0.05, rel=0.15)  # nothing but the white noise is left


@pytest.mark.parametrize("kind", ["chain", "network"])
def test_a_prediction_is_at_the_level_of_its_record(kind, request):
    fit = request.getfixturevalue(kind)
    raw = coloured().select(300, 600)
    np.testing.assert_allclose(fit.predict(raw, 4) - VALIDATION.y_offset, fit.predict(VALIDATION, 4), atol=1e-8)


def test_a_missing_output_is_no_measurement(chain):
    lost = np.zeros(VALIDATION.N, dtype=bool)
    lost[100:104] = True
    wild = VALIDATION.y.copy()
    wild[lost] = 1e6
    holed = replace(VALIDATION, y=wild, missing=lost)
    found = chain.predict(holed, 1)
    np.testing.assert_allclose(found[104:], chain.predict(VALIDATION, 1)[104:], atol=0.6)
    v = np.array([1.0, 2.0, 9.0, 4.0])
    np.testing.assert_allclose(
        forecast(v, (0.5,), 1, np.array([True, True, False, True])), [0.0, 0.5, 1.0, 0.5], atol=1e-15
    )


@pytest.mark.parametrize("kind", ["chain", "network"])
@pytest.mark.parametrize("horizon", [0, 1.5, -1])
def test_a_horizon_that_is_none_is_refused(kind, horizon, request):
    with pytest.raises(InputError, match="give a whole number of samples of at least 1"):
        request.getfixturevalue(kind).predict(VALIDATION, horizon)


def test_a_saved_chain_keeps_its_noise(chain, tmp_path):
    again = sysid.load(chain.save(tmp_path / "model.json"))
    assert again.noise == chain.noise
    np.testing.assert_array_equal(again.predict(VALIDATION, 3), chain.predict(VALIDATION, 3))

"""Criteria and residual tests against numbers worked out by hand and against independent implementations."""

import numpy as np
import pytest
from scipy.signal import correlate

from sysid import InputError, residual_tests
from sysid.base.criteria import TABLE, criteria, fit_percent


def test_criteria_of_a_worked_example():
    """N 300, V 1.6575, d 6, worked by hand."""
    c = criteria(1.6575, 300, 6)
    assert c.fpe == pytest.approx(1.7252, abs=5e-5)
    assert c.aic == pytest.approx(1015.0, abs=5e-2)
    assert c.naic == pytest.approx(0.5453, abs=5e-5)
    assert c.bic == pytest.approx(1037.2, abs=5e-2)
    assert c.aicc == pytest.approx(c.aic + 84 / 293)


def test_criteria_that_N_does_not_allow_are_infinite():
    assert criteria(1.0, 6, 6).fpe == np.inf
    assert criteria(1.0, 7, 6).aicc == np.inf


def test_criteria_follow_from_the_errors_as_they_are_not_from_the_loss():
    heavy, plain = criteria(165.75, 300, 6, mse=1.6575), criteria(1.6575, 300, 6)
    assert heavy.as_dict() == {**plain.as_dict(), "loss": 165.75}


def test_a_criterion_enters_by_one_line(monkeypatch):
    """Hannan and Quinn 1979: N ln V + 2 d ln ln N. By name, as an attribute, in what a fit says, and offered."""
    monkeypatch.setitem(TABLE, "hqic", lambda c: c.N * np.log(c.mse) + 2 * c.d * np.log(np.log(c.N)))
    c = criteria(1.6575, 300, 6)
    assert c.hqic == c.as_dict()["hqic"] == pytest.approx(151.5931 + 20.8936, abs=1e-3)
    assert {"hqic", "bic", "loss"} <= set(dir(c))
    with pytest.raises(AttributeError, match="no criterion 'bick'; choose one of fpe, aic"):
        _ = c.bick


def test_fit_percent_by_hand():
    y = np.array([1.0, 2.0, 3.0, 4.0])  # ||y - mean|| = sqrt 5
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, 2.5)) == 0.0
    assert fit_percent(y, y + np.array([0.5, -0.5, 0.5, -0.5])) == pytest.approx(100 * (1 - 1 / np.sqrt(5)))
    assert fit_percent(y, np.full(4, np.nan)) == -np.inf
    assert fit_percent(np.ones(3), np.ones(3)) == 100.0
    assert fit_percent(np.ones(3), np.zeros(3)) == -np.inf


def test_correlations_agree_with_scipy():
    rng = np.random.default_rng(5)
    e, u = rng.normal(size=400), rng.normal(size=400)
    t = residual_tests(e, u, max_lag=10)
    e0, u0 = e - e.mean(), u - u.mean()
    full = correlate(e0, u0, "full") / np.sqrt(e0 @ e0 * (u0 @ u0))
    np.testing.assert_allclose(t.cross_correlation, full[399 - 10 : 399 + 11], atol=1e-12)
    np.testing.assert_allclose(t.autocorrelation, correlate(e0, e0, "full")[399 : 399 + 11] / (e0 @ e0), atol=1e-12)
    assert t.whiteness_bound == pytest.approx(2.5758 / 20, abs=1e-5)


def test_white_noise_passes_and_the_bounds_hold_their_level():
    """2000 white records: a lag leaves its 99 % bound in 1 % of cases, within four standard errors."""
    rng = np.random.default_rng(6)
    white = crossed = 0
    for _ in range(2000):
        t = residual_tests(rng.normal(size=500), rng.normal(size=500))
        white, crossed = white + t.whiteness_outside, crossed + t.independence_outside
    assert abs(white / 2000 / 25 - 0.01) < 0.002
    assert abs(crossed / 2000 / 51 - 0.01) < 0.002


def test_a_moving_average_fails_whiteness_and_a_filtered_input_fails_independence():
    rng = np.random.default_rng(7)
    e, u = rng.normal(size=1000), rng.normal(size=1000)
    coloured = residual_tests(e[1:] + 0.5 * e[:-1], u[1:])
    assert not coloured.white
    assert coloured.independent
    assert np.argmax(np.abs(coloured.autocorrelation[1:])) == 0  # r(1) = 0.4 stands out at lag 1
    assert not residual_tests(e[3:] + 0.3 * u[:-3], u[3:]).independent


def test_too_few_residuals():
    with pytest.raises(InputError, match="more than 50"):
        residual_tests(np.zeros(50), np.zeros(50))

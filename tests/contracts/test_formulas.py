"""Criteria and residual tests against numbers worked out by hand and against independent implementations."""

import numpy as np
import pytest
from cases import CRITERIA
from often import often
from scipy.signal import correlate, lfilter

from sysid import InputError, residual_tests
from sysid.base.criteria import TABLE, Criterion, criteria, fit_percent
from sysid.diagnosis.residuals import _allowed_count as allowed


@pytest.mark.parametrize("name", TABLE)
def test_a_criterion_gives_what_was_worked_out_by_hand(name):
    """N 300, V 1.6575, d 6."""
    assert name in CRITERIA, f"work {name} out by hand for N 300, V 1.6575, d 6 and add a line to tests/cases.py"
    value, tolerance = CRITERIA[name]
    assert getattr(criteria(1.6575, 300, 6), name) == pytest.approx(value, abs=tolerance)


@pytest.mark.parametrize("name", TABLE)
def test_a_criterion_has_a_label_of_its_own_and_says_what_it_means(name):
    entry = TABLE[name]
    assert entry.label.lower() == name
    assert 10 < len(entry.meaning) < 90
    # One with the unit of y squared grows with V; the others are -2 ln of a likelihood, of which V is a summand.
    large, small = (entry.formula(criteria(v, 300, 6)) for v in (4.0, 1.0))
    assert (large == pytest.approx(4 * small)) == entry.squared


def test_criteria_that_N_does_not_allow_are_infinite():
    assert criteria(1.0, 6, 6).fpe == np.inf
    assert criteria(1.0, 7, 6).aicc == np.inf


def test_criteria_follow_from_the_errors_as_they_are_not_from_the_loss():
    heavy, plain = criteria(165.75, 300, 6, mse=1.6575), criteria(1.6575, 300, 6)
    assert heavy.as_dict() == {**plain.as_dict(), "loss": 165.75}


def hannan_quinn(c):
    return c.N * np.log(c.mse) + 2 * c.d * np.log(np.log(c.N))


def test_a_criterion_enters_by_one_line(monkeypatch):
    """Hannan and Quinn 1979: N ln V + 2 d ln ln N. By name, as an attribute, in what a fit says, and offered."""
    monkeypatch.setitem(TABLE, "hqic", Criterion(hannan_quinn, "HQIC", "between AIC and BIC"))
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
    """A lag of a white record leaves its 99 % bound in 1 % of cases, within four standard errors of 2,000 records."""
    rng = np.random.default_rng(6)
    white = crossed = 0
    n = len(often(2000, 500))
    for _ in range(n):
        t = residual_tests(rng.normal(size=500), rng.normal(size=500))
        white, crossed = white + t.whiteness_outside, crossed + t.independence_outside
    assert abs(white / n / 25 - 0.01) < 0.002 * np.sqrt(2000 / n)
    assert abs(crossed / n / 51 - 0.01) < 0.002 * np.sqrt(2000 / n)


def test_a_moving_average_fails_whiteness_and_a_filtered_input_fails_independence():
    rng = np.random.default_rng(7)
    e, u = rng.normal(size=1000), rng.normal(size=1000)
    coloured = residual_tests(e[1:] + 0.5 * e[:-1], u[1:])
    assert not coloured.white
    assert coloured.independent
    assert np.argmax(np.abs(coloured.autocorrelation[1:])) == 0  # r(1) = 0.4 stands out at lag 1
    assert not residual_tests(e[3:] + 0.3 * u[:-3], u[3:]).independent


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.98])
def test_the_verdict_of_independence_keeps_its_level_under_a_coloured_input(pole):
    """600 records: at 1 % at most 16 false verdicts but for one case in a thousand; the bound is never zero."""
    failed = 0
    for seed in range(600):
        rng = np.random.default_rng([8, seed])
        u = lfilter([1.0], [1.0, -pole], rng.normal(size=800))
        t = residual_tests(rng.normal(size=800), u)
        failed += not t.independent
        assert t.independence_bound > 0
    assert failed <= 16


def test_too_few_residuals():
    with pytest.raises(InputError, match="more than 50"):
        residual_tests(np.zeros(50), np.zeros(50))


def test_how_many_lags_may_lie_outside_and_how_short_a_row_may_be():
    """Binomial by hand: of 50 lags at 1 % each, P(2 or fewer) = 0.986, P(3 or fewer) = 0.998; of 25, P(1) = 0.974."""
    assert [allowed(50, 0.99), allowed(25, 0.99)] == [3, 2]
    e, u = np.random.default_rng(0).standard_normal((2, 51))
    assert len(residual_tests(e, u).cross_lags) == 51
    with pytest.raises(InputError, match="give more than 50"):
        residual_tests(e[:50], u[:50])

"""A value at a bound has no interval: it cannot move there, and the record does not say that it is there exactly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.linear.linearize import tangent_at
from sysid.notebook.page import identified
from sysid.plots.pole_zero import roots_figure
from sysid.report import verdict
from sysid.report.bands import bands
from sysid.report.figures import TABLE
from sysid.report.sections import pole_grid
from sysid.structures import output_error
from sysid.uncertainty import intervals
from sysid.uncertainty.information import BOUND


def drifting(N=400):
    """An integrator with a drift upwards, which a pole beyond the unit circle would follow."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], N // 10), 10)
    y = lfilter([0.0, 1.0], [1.0, -1.0], u) + 0.5 * rng.standard_normal(N) + 0.01 * np.arange(N) ** 1.2
    return sysid.IOData(u, y, Ts=0.1)


def test_a_pole_on_the_unit_circle_has_no_deviation(tmp_path):
    data = drifting()
    fit = sysid.fit(output_error(1, 1, 1), data)
    assert fit.poles[0] == pytest.approx(1.0, abs=1e-12)
    for found in (fit, sysid.load(fit.save(tmp_path / "fit.json"))):
        assert np.isnan(found.pole_std[0])
        gain, f1, _ = found.parameters
        assert f1.name == "linear.f1"
        assert f1.std is None
        assert gain.std > 0.0
    info = sysid.information(fit, data)
    for value in (intervals.poles(info)[0].real, intervals.parameters(info)["linear.f1"]):
        assert np.isnan(value.std)
        assert (value.lower, value.upper, value.note) == (-np.inf, np.inf, BOUND)
    assert intervals.parameters(info)["linear.b0"].std > 0.0


def test_the_other_pole_of_an_integrator_keeps_its_interval():
    """The bound holds F(1) = 0: the coefficients move with the other pole, the one at 1 does not."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.choice([-1.0, 1.0], 80), 10)
    y = lfilter([0.0, 0.3], np.poly([1.001, 0.7]), u) + 0.2 * rng.standard_normal(800)
    data = sysid.IOData(u, y, Ts=0.1)
    fit = sysid.fit(output_error(1, 2, 1), data)
    at_one = np.abs(fit.poles - 1.0) < 1e-9
    assert at_one.sum() == 1
    assert np.isnan(fit.pole_std[at_one]).all()
    assert 0.0 < fit.pole_std[~at_one][0] < 0.1
    roots = intervals.poles(sysid.information(fit, data))
    assert [np.isnan(r.std) for r in roots] == at_one.tolist()


def test_a_parameter_at_a_bound_of_the_user_has_none_and_a_fixed_one_is_no_estimate():
    rng = np.random.default_rng(2)
    u = rng.standard_normal(400)
    data = sysid.IOData(u, lfilter([0.0, 0.5], [1.0, -0.8], u) + 0.05 * rng.standard_normal(400), Ts=0.1)
    name = "linear.f1"
    bounded = sysid.fit(output_error(1, 1, 1, bounds={name: (-0.7, 0.0)}), data)
    fixed = sysid.fit(output_error(1, 1, 1, fixed={name: -0.7}), data)
    assert dict(zip(bounded.model.names, bounded.theta, strict=True))[name] == -0.7
    assert np.isnan(bounded.pole_std[0])
    assert intervals.parameters(sysid.information(bounded, data))[name].note == BOUND
    assert fixed.pole_std[0] == 0.0


@pytest.mark.parametrize(
    ("below", "word", "lasting"),
    [(1e-12, "integrates", "–"), (2e-7, "is stable", "500000"), (-1e-3, "is not stable", "–")],
)
def test_a_pole_that_rounding_leaves_below_one_integrates_everywhere(below, word, lasting):
    data = drifting()
    fit = sysid.fit(output_error(1, 1, 1), data)
    theta = fit.theta.copy()
    theta[fit.model.names.index("linear.f1")] = below - 1.0
    fit = replace(fit, theta=theta)
    e = identified(fit, data, None).evaluation
    assert e.stable == (word == "is stable")
    assert verdict.stability(e).startswith(f"It {word}: poles ")
    assert f"the model {word} (poles" in TABLE["pole-zero"].caption(e)
    assert pole_grid(e).rows[0][4] == lasting
    assert fit.modes()[0].time_constant == (pytest.approx(0.1 / below) if word == "is stable" else np.inf)
    hover = roots_figure(fit.poles, Ts=fit.Ts).panels[0].items[3].texts[0]
    assert ("time constant" in hover) == (word == "is stable")
    assert tangent_at(fit).integrates == (word == "integrates")
    assert ("does not settle" in TABLE["step-response"].caption(e)) == (word != "is stable")
    assert (bands(e).frequency is None) == (word == "is not stable")

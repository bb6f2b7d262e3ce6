"""A fit may begin at another fit; what is no start is named in a short sentence."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.structures import output_error, state_space

MODEL = output_error(1, 1, 1)


def record(seed: int) -> IOData:
    rng = np.random.default_rng(seed)
    u, y = rng.standard_normal(300), np.zeros(300)
    for k in range(1, 300):
        y[k] = 0.8 * y[k - 1] + 0.3 * u[k - 1]
    return IOData(u, y + 0.05 * rng.standard_normal(300), 0.1)


def test_a_fit_as_start_is_its_parameters_as_start():
    first = sysid.fit(MODEL, record(0))
    again, numbers = (sysid.fit(MODEL, record(1), start=start) for start in (first, first.theta))
    np.testing.assert_array_equal(again.theta, numbers.theta)
    assert not np.array_equal(again.theta, first.theta)
    assert dict(zip(MODEL.names, again.theta, strict=True))["linear.f1"] == pytest.approx(-0.8, abs=0.02)


def test_what_is_no_start_is_said_shortly():
    first = sysid.fit(MODEL, record(0))
    with pytest.raises(
        InputError, match=r"start is a fit of a output_error with 3 parameters, and those of this model"
    ):
        sysid.fit(output_error(2, 2, 1), record(0), start=first)
    with pytest.raises(InputError, match=r"^start is of type str; give 3 numbers, several such rows, or a fit$"):
        sysid.fit(MODEL, record(0), start="there")


def bent(seed: int, N: int) -> tuple[np.ndarray, np.ndarray]:
    """|0.9^k filter of u| with noise: a state space needs many iterations for it."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(N)
    return u, np.abs(lfilter([0.0, 1.0], [1.0, -0.9], u)) + 0.1 * rng.standard_normal(N)


def test_a_refined_fit_is_no_worse_although_smoothing_costs_errors():
    """The search ended 16 % higher: what fell was the cost with the kinks of the state space."""
    few = sysid.Options(max_iterations=1)
    fit = sysid.fit(state_space(2, 1), IOData(*bent(3, 150), 0.1), options=few, starts=2)
    again = fit.refine(search="lm")
    assert again.criteria.mse <= fit.criteria.mse
    own = np.mean((again.record.y[:, 0] - again.model.simulate(again.theta, again.record.u)) ** 2)
    assert again.criteria.mse == pytest.approx(own, rel=1e-9)


def test_a_refined_fit_of_several_experiments_that_ends_higher_is_the_fit_itself():
    u, y = bent(3, 150)
    data = IOData.merge(IOData(u[:75], y[:75], 0.1), IOData(u[75:], y[75:], 0.1))
    fit = sysid.fit(state_space(1, 1), data, options=sysid.Options(max_iterations=1), starts=1)
    low = replace(fit, criteria=replace(fit.criteria, mse=1e-3 * fit.criteria.mse)).remember(data)
    again = low.refine(options=sysid.Options(max_iterations=2))
    np.testing.assert_array_equal(again.theta, fit.theta)
    assert any("a further search ended at a mean square error of" in text for text in again.warnings)
    assert again.record is data

"""A fit in one unit is not scored on a record that states another one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import InputError, IOData
from sysid.estimation.fit import _outside_bounds
from sysid.solver.iterate import Options


@pytest.fixture(scope="module")
def records():
    rng = np.random.default_rng(0)
    u = rng.normal(size=400)
    y = lfilter([0.0, 1.0], [1.0, -0.7], u) + 0.01 * rng.normal(size=400)
    return IOData(u, y, 0.01, u_unit="V", y_unit="rad"), IOData(u, y * 180 / np.pi, 0.01, u_unit="V", y_unit="deg")


@pytest.mark.parametrize("model", [sysid.structures.output_error(1, 1, 1), sysid.structures.nlarx(na=1, nb=1, units=0)])
def test_every_call_with_a_record_in_another_unit_is_refused(records, model):
    own, other = records
    fit = sysid.fit(model, own, starts=1)
    calls = (
        fit.simulate, fit.predict, fit.fit_percent, fit.fit_percents, fit.residuals, fit.residual_tests, fit.own_level,
        lambda data: sysid.compare(data, fit),
    )  # fmt: skip
    for call in calls:
        with pytest.raises(InputError, match="the output of the record is in deg and the model's in rad; convert the"):
            call(other)
        call(own)
    with pytest.raises(InputError, match="the input of the record is in mV and the model's in V"):
        fit.simulate(replace(own, u_unit="mV"))
    for spelled in ("rad ", "r·ad", "-", "?"):
        assert fit.fit_percent(replace(own, y_unit=spelled)) == fit.fit_percent(own)
    if model.structure == "output_error":
        with pytest.raises(InputError, match="the output of the record is in deg"):
            fit.refine(other)
    bare = sysid.fit(model, replace(own, u_unit="", y_unit=""), starts=1)
    assert bare.fit_percent(own) == pytest.approx(fit.fit_percent(own))
    unknown = fit.fit_percents(replace(own, u_unit="", y_unit=""))
    np.testing.assert_array_equal(unknown, fit.fit_percents(own))
    assert unknown.shape == (1,)
    assert unknown[0] == fit.fit_percent(own) > 95.0


@pytest.mark.parametrize("seed", [2, 3, 5])
def test_a_fit_beside_its_bounds_says_so_and_loads(seed, tmp_path):
    """Knots of a profile keep an order of their own, and a search may end beside bounds that are against it."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, 20), 15)
    data = IOData(u, lfilter([0.0, 0.1], [1.0, -0.9], np.tanh(u)), 0.01)
    model = sysid.structures.motor_profile(3, bounds={"motor.rise1": (-np.inf, 0.0)})
    try:
        fit = sysid.fit(model, data, starts=1, options=Options(max_iterations=4))
    except InputError:  # no start keeps to the block's limits and to these bounds
        return
    beside = fit.theta[fit.model.names.index("motor.rise1")] > 0.0
    assert beside == any("motor.rise1 ended outside the bounds" in warning for warning in fit.warnings)
    back = sysid.load(fit.save(tmp_path / "fit.json"))
    np.testing.assert_array_equal(back.theta, fit.theta)


@pytest.mark.parametrize(
    ("b0", "told"), [(0.5, []), (0.0, []), (-1e-13, []), (-1e-3, ["linear.b0"]), (2.0, ["linear.b0"])]
)
def test_only_what_is_beyond_rounding_is_beside_its_bounds(b0, told):
    model = sysid.structures.output_error(1, 1, 1, bounds={"linear.b0": (0.0, 1.0)})
    theta = np.zeros(len(model.names))
    theta[model.names.index("linear.f1")], theta[model.names.index("linear.b0")] = -0.5, b0
    assert _outside_bounds(model, theta) == told


def test_a_bound_that_holds_is_not_told(tmp_path):
    rng = np.random.default_rng(2)
    u = rng.normal(size=300)
    data = IOData(1e-9 * u, 1e6 * lfilter([0.0, 1.0], [1.0, -0.7], u), 0.01)
    model = sysid.structures.output_error(1, 1, 1, bounds={"linear.b0": (-np.inf, 0.0)})
    fit = sysid.fit(model, data, starts=1)
    assert not any("bounds" in warning for warning in fit.warnings)
    np.testing.assert_array_equal(sysid.load(fit.save(tmp_path / "fit.json")).theta, fit.theta)


def test_a_value_that_is_held_beside_its_bounds_is_refused():
    with pytest.raises(InputError, match=r"linear.b0 is fixed at 2, outside its bounds; leave one out"):
        sysid.structures.output_error(1, 1, fixed={"linear.b0": 2.0}, bounds={"linear.b0": (0.0, 1.0)})


def test_sensitivities_that_are_no_numbers_end_in_no_traceback():
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-6, 6, 20), 25)
    y = np.cumsum(u) * 1e-3
    try:
        fit = sysid.fit(sysid.structures.servo_joint(), IOData(u * 1e-9, (y + 1e4) * 1e6, 0.013), starts=1)
    except InputError:
        return
    assert np.all(np.isfinite(fit.theta))

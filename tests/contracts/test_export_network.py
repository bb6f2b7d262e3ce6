"""A nonlinear ARX model as C and Python: the run of `NlarxFit.simulate`, sample by sample."""

import math
from dataclasses import replace

import numpy as np
import pytest
from exported import c_run, python_run, python_space

import sysid
from sysid import InputError, IOData
from sysid.data.preprocess import detrend
from sysid.export import c as export_c
from sysid.export import closed_form

ORDERS = [(2, 2, 1, "auto"), (1, 2, 0, 3), (3, 1, 4, 2), (2, 2, 1, 0), (0, 3, 1, 2), (2, 0, 0, 1)]


def record(N=500, seed=0):
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-1, 1, N // 5), 5), np.zeros(N)
    for t in range(1, N):
        y[t] = 0.7 * y[t - 1] + np.tanh(2 * u[t - 1]) + 0.1 * u[t]
    return IOData(u + 3.0, y - 50.0 + 0.01 * rng.standard_normal(N), 0.1)


@pytest.fixture(scope="module", params=ORDERS, ids=str)
def fit(request):
    na, nb, nk, units = request.param
    return sysid.fit(sysid.structures.nlarx(na, nb, nk, units=units), detrend(record()), starts=1)


def agrees(y, expected):
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))


def test_c_and_python_take_raw_inputs_and_give_raw_outputs(fit, tmp_path):
    """The run from rest at the offsets: an input alone is counted from them, the files are not."""
    u = record(seed=1).u[:, 0]
    expected = fit.simulate(u - fit.u_offset[0]) + fit.y_offset[0]
    assert np.ptp(expected) > 0.1 or not fit.model.nb
    agrees(python_run(fit, u), expected)
    agrees(c_run(fit, u, tmp_path, "net"), expected)
    own = fit.simulate(u)
    agrees(python_run(fit, u, u_offset=0.0, y_offset=0.0), own)
    agrees(c_run(fit, u, tmp_path, u_offset=0.0, y_offset=0.0), own)


def test_a_run_that_diverges_stays_infinite(tmp_path):
    fit = sysid.fit(sysid.structures.nlarx(1, 1, 1, units=1), detrend(record()), starts=1)
    theta = fit.theta.copy()
    theta[1] = 1.5  # dy/dy(t-1)
    wild = replace(fit, theta=theta, u_offset=np.zeros(1), y_offset=np.zeros(1))
    u = record(seed=1).u[:, 0]
    expected = wild.simulate(u)
    assert np.isinf(expected[-1])
    n = int(np.argmax(np.isinf(expected)))
    for y in (python_run(wild, u), c_run(wild, u, tmp_path)):
        np.testing.assert_allclose(y[:n], expected[:n], rtol=1e-9)
        assert np.all(np.isinf(y[n:]))


def test_the_closed_form_is_the_network():
    fit = sysid.fit(sysid.structures.nlarx(2, 1, 1, units=2), detrend(record()), starts=1)
    lines = closed_form.text(fit, None).splitlines()
    assert f"u = input - {float(fit.u_offset[0])!r}" in lines
    assert f"output = y - {float(-fit.y_offset[0])!r}" in lines
    u, y = np.array([0.3, -0.2, 0.5]), np.array([0.1, -0.3, 0.0])
    space = {"exp": math.exp, "u": lambda t: u[t], "y": lambda t: y[t], "t": 2}
    for line in lines[lines.index("network:") + 1 :]:
        name, _, formula = line.partition(" = ")
        value = eval(formula.replace("^", "**"), space)
        space[name.removesuffix("(t)")] = lambda t, value=value: value
    assert value == pytest.approx(fit.network.predict(fit.theta, np.array([[y[1], y[0], u[1]]]))[0][0], rel=1e-12)


def test_the_python_file_starts_anew_with_each_model():
    fit = sysid.fit(sysid.structures.nlarx(2, 2, 1, units=1), detrend(record()), starts=1)
    space = python_space(fit)
    first = space["Model"]()
    assert [first.step(v) for v in (3.2, 2.5)] == space["simulate"]([3.2, 2.5])


def test_numbers_that_are_none_are_refused():
    fit = sysid.fit(sysid.structures.nlarx(1, 1, 1, units=0), detrend(record()), starts=1)
    with pytest.raises(InputError, match="not finite"):
        export_c.source(replace(fit, theta=fit.theta * np.nan))

"""A fit from a linear model begins at its loss and ends at the plant; the interval of a delay holds it."""

import numpy as np
import pytest

import sysid
from sysid.estimation.fit_from import starting_thetas
from sysid.systems import system


@pytest.fixture(scope="module")
def data():
    d = system("textbook").record(600, 0.05, np.random.default_rng(4))
    return sysid.IOData(d.u + 1.0, d.y, d.Ts)  # off centre, where maps and means differ


@pytest.fixture(scope="module")
def linear(data):
    return sysid.fit(sysid.structures.output_error(nb=2, nf=2, nk=1, offset="free"), data, search="lm", starts=1)


@pytest.mark.parametrize("maps", [{}, {"input": "saturation"}, {"output": "unit_gain"}, {"input": "polynomial"}])
def test_the_search_starts_near_the_loss_of_the_linear_model_and_lowers_it(data, linear, maps):
    model = sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1, **maps)
    chain, thetas = starting_thetas(linear, model, data)
    for theta, most in zip(thetas, (1.3, 1.0001), strict=True):  # maps that bend a little, and straight ones
        run = chain.simulate(theta, data.u[:, 0])
        offset = np.mean(data.y[:, 0] - run) if "output" in maps else 0.0  # a unit gain cannot hold the offset
        assert np.mean((data.y[:, 0] - run - offset) ** 2) < most * linear.criteria.mse
    found = sysid.fit_from(linear, model, data, search="lm")
    assert found.record is data
    if "output" not in maps:
        assert found.criteria.mse < 0.5 * linear.criteria.mse
    np.testing.assert_array_equal(chain.part(theta, chain.linear), linear.theta[: len(chain.part(theta, chain.linear))])


def test_a_map_that_cannot_hold_the_offset_is_told():
    rng = np.random.default_rng(0)
    u = rng.normal(size=400)
    y = np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.8 * y[k - 1] + 0.5 * u[k - 1]
    y = np.clip(y, -2, 2) + 0.3
    for level, told in ((0.3, True), (0.0, False)):
        data = sysid.IOData(u, y - 0.3 + level, 0.1)
        base = sysid.fit(sysid.structures.output_error(1, 1, 1, offset="free"), data)
        found = sysid.fit_from(base, sysid.structures.wiener(1, 1, 1, output="saturation"), data)
        assert (found.criteria.mse > 1.01 * base.criteria.mse) == told
        assert any("times that of the fit that this one starts from" in text for text in found.warnings) == told


def test_held_parameters_stay_held(data, linear):
    model = sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1, input="saturation", fixed={"input": (0.0, 2.4)})
    found = sysid.fit_from(linear, model, data, search="lm")
    assert [p.value for p in found.parameters[:2]] == [0.0, 2.4]


def test_what_cannot_start_is_refused(data, linear):
    with pytest.raises(sysid.InputError, match="'linear' of the model is not in the fit with the same orders"):
        sysid.fit_from(linear, sysid.structures.hammerstein_wiener(nb=2, nf=3, nk=1), data)
    with pytest.raises(sysid.InputError, match="leave starts out"):
        sysid.fit_from(linear, sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1), data, starts=3)
    with pytest.raises(sysid.InputError, match="resample it first"):
        sysid.fit_from(linear, linear.model, sysid.IOData(data.u, data.y, 0.2))
    with pytest.raises(sysid.InputError, match="several inputs or outputs"):
        sysid.fit_from(linear, sysid.structures.output_error(nu=2), data)


@pytest.mark.parametrize("nk", [1, 4])
def test_a_delay_is_found_with_its_interval(nk):
    rng = np.random.default_rng(nk)
    u = np.repeat(rng.normal(size=200), 3)
    y = np.zeros(600)
    for t in range(nk + 1, 600):
        y[t] = 0.8 * y[t - 1] + u[t - nk]
    data = sysid.IOData(np.column_stack([rng.normal(size=600), u]), y + 0.1 * rng.normal(size=600), 0.02)
    found = sysid.delay(data, input=1)
    assert found.nk == nk
    assert found.low <= nk <= found.high <= nk + 1
    assert f"nk = {nk} ({0.02 * nk:g} s)" in str(found)
    none = sysid.delay(data, input=0)
    assert none.nk is None
    assert "check that the columns belong together" in str(none)


def test_a_delay_that_cannot_be_asked_for_is_refused(data):
    with pytest.raises(sysid.InputError, match="output is 1; the record has 1, numbered from 0"):
        sysid.delay(data, output=1)
    with pytest.raises(sysid.InputError, match="level is 99"):
        sysid.delay(data, level=99)
    with pytest.raises(sysid.InputError, match="too few"):
        sysid.delay(data[:20])

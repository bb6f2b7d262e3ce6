"""A model carries the offsets that were removed from its estimation data, and so runs on records of any level."""

import json
from dataclasses import replace

import numpy as np
import pytest

import sysid
from sysid import IOData
from sysid.data.preprocess import detrend, quick_start
from sysid.uncertainty import bands


def plant(N=400, seed=0):
    """A lag of second order about a working point, with levels that a model of deviations does not see."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(1.0, 3.0, N // 5), 5)
    y = np.zeros(N)
    for t in range(2, N):
        y[t] = 1.3 * y[t - 1] - 0.4 * y[t - 2] + 0.2 * np.tanh(u[t - 1] - 2.0) + 0.05 * (u[t - 2] - 2.0)
    return IOData(u, y + 40.0 + 0.003 * rng.standard_normal(N), 0.1, "volts", "height", "V", "m")


RAW = plant()
ESTIMATION, VALIDATION = quick_start(RAW)


@pytest.fixture(scope="module", params=["chain", "nlarx"])
def fit(request):
    model = {"chain": sysid.structures.output_error(2, 2, 1), "nlarx": sysid.structures.nlarx(2, 2, 1, units=2)}
    return sysid.fit(model[request.param], ESTIMATION)


def test_a_fit_to_mean_free_data_runs_on_the_raw_record(fit):
    """Also on a part of the record that has lost its own mean, which is another one."""
    raw, n = RAW.select(200, 400), fit.n_init
    seen = fit.fit_percent(VALIDATION)
    assert seen > 70.0
    own = detrend(raw)
    assert abs(own.u_offset - ESTIMATION.u_offset) > 0.01
    for data in (raw, own):
        assert fit.fit_percent(data) == pytest.approx(seen, abs=1e-6)
        np.testing.assert_allclose(
            fit.simulate(data) + data.y_offset, fit.simulate(VALIDATION) + VALIDATION.y_offset, atol=1e-8
        )
        np.testing.assert_allclose(fit.residuals(data), fit.residuals(VALIDATION), atol=1e-8)
    row = sysid.compare(raw, fit).rows[0]
    assert row.fit == pytest.approx(seen, abs=1e-6)
    assert row.rmse == pytest.approx(np.sqrt(np.mean((raw.y[n:, 0] - fit.simulate(raw)[n:]) ** 2)))


def test_wrong_offsets_do_not_pass_unnoticed(fit):
    """What the test above would show for a model that forgot its offsets, or took them with the wrong sign."""
    raw, seen = RAW.select(200, 400), fit.fit_percent(VALIDATION)
    for u0, y0 in ((None, None), (fit.u_offset * 0, fit.y_offset), (fit.u_offset, -fit.y_offset)):
        assert replace(fit, u_offset=u0, y_offset=y0).fit_percent(raw) < seen - 2.0


def test_records_with_the_same_offsets_are_not_touched(fit):
    assert fit.own_level(VALIDATION) is VALIDATION
    forgetful = replace(fit, u_offset=None, y_offset=None)
    np.testing.assert_array_equal(fit.simulate(VALIDATION), forgetful.simulate(VALIDATION))
    assert fit.fit_percent(VALIDATION) == forgetful.fit_percent(VALIDATION)
    np.testing.assert_array_equal(fit.simulate(VALIDATION.u[:, 0]), forgetful.simulate(VALIDATION.u[:, 0]))


def test_offsets_and_origin_are_saved(fit, tmp_path):
    path = fit.save(tmp_path / "model.json")
    again = sysid.load(path)
    np.testing.assert_array_equal(again.u_offset, RAW.u.mean(axis=0))
    np.testing.assert_array_equal(again.y_offset, RAW.y.mean(axis=0))
    assert again.origin == fit.origin
    assert (fit.origin.u_name, fit.origin.y_unit, fit.origin.samples) == ("volts", "m", 200)
    chain = isinstance(fit, sysid.Fit)
    own, n = (fit.model.simulate(fit.theta, ESTIMATION.u), 0) if chain else (fit.simulate(ESTIMATION), fit.n_init)
    e, y = (ESTIMATION.y[:, 0] - own)[n:], ESTIMATION.y[n:, 0]
    assert fit.origin.fit == pytest.approx(100 * (1 - np.linalg.norm(e) / np.linalg.norm(y - y.mean())), abs=1e-6)


def test_a_file_of_before_says_that_its_offsets_are_unknown(fit, tmp_path):
    path = fit.save(tmp_path / "model.json")
    document = json.loads(path.read_text())
    for name in ("u_offset", "y_offset", "origin"):
        del document[name]
    path.write_text(json.dumps(document | {"version": document["version"] - 1}))
    old = sysid.load(path)
    assert old.u_offset is None
    assert old.y_offset is None
    assert old.origin is None
    raw = RAW.select(200, 400)
    np.testing.assert_array_equal(old.simulate(VALIDATION), fit.simulate(VALIDATION))
    assert old.fit_percent(raw) < 0.0  # as it is: nothing is known to take away


@pytest.mark.parametrize("offset", [[0.0, 1.0], None, ["nan"]])
def test_offsets_that_do_not_belong_to_the_model_are_refused(fit, tmp_path, offset):
    path = fit.save(tmp_path / "model.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"u_offset": offset}))
    with pytest.raises(sysid.InputError, match=r"u_offset is not a finite number for each of 1 channel"):
        sysid.load(path)


def test_a_band_is_at_the_level_of_its_record():
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), ESTIMATION, starts=1)
    info, raw = sysid.information(fit, ESTIMATION), RAW.select(200, 400)
    band, own = bands.linear(info, raw), bands.linear(info, VALIDATION)
    for name in ("y", "lower", "upper"):
        expected = getattr(own, name) + VALIDATION.y_offset[0]
        np.testing.assert_allclose(getattr(band, name), expected, atol=1e-7)
    again = sysid.information(fit, RAW.select(0, 200))
    np.testing.assert_allclose(again.cov, info.cov, rtol=1e-6)

"""A fit in one unit is not scored on a record that states another one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import InputError, IOData


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
    bare = sysid.fit(model, replace(own, u_unit="", y_unit=""), starts=1)
    assert bare.fit_percent(own) == pytest.approx(fit.fit_percent(own))
    unknown = fit.fit_percents(replace(own, u_unit="", y_unit=""))
    np.testing.assert_array_equal(unknown, fit.fit_percents(own))
    assert unknown.shape == (1,)
    assert unknown[0] == fit.fit_percent(own) > 95.0

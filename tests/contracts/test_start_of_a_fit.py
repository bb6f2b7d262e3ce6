"""A fit may begin at another fit; what is no start is named in a short sentence."""

import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.structures import output_error

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

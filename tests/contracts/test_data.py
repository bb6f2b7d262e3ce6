"""IOData and preprocessing: bad records are refused in a sentence, good ones keep their numbers."""

import numpy as np
import pytest

from sysid import InputError, IOData
from sysid.data.preprocess import detrend, quick_start, retrend


@pytest.mark.parametrize(
    ("u", "y", "Ts", "says"),
    [
        ([1.0, 2.0], [1.0], 0.1, "same length"),
        ([1.0], [1.0], 0.1, "at least 2"),
        ([1.0, np.nan, 3.0], [1.0, 2.0, 3.0], 0.1, "u is nan at sample 1"),
        ([1.0, 2.0, 3.0], [1.0, 2.0, -np.inf], 0.1, "y is -inf at sample 2"),
        (["a", "b"], [1.0, 2.0], 0.1, "not real numbers"),
        ([1 + 2j, 2.0], [1.0, 2.0], 0.1, "not real numbers"),
        ([1.0, 2.0], [1.0, 2.0], 0.0, "positive number of seconds"),
        ([1.0, 2.0], [1.0, 2.0], np.nan, "positive number of seconds"),
        ([1.0, 2.0], [1.0, 2.0], "0.1", "positive number of seconds"),
        (np.zeros((2, 2, 2)), [1.0, 2.0], 0.1, "shape"),
    ],
)
def test_bad_records(u, y, Ts, says):
    with pytest.raises(InputError, match=says):
        IOData(u, y, Ts)


def test_integers_and_strided_arrays_become_contiguous_floats():
    table = np.arange(20).reshape(10, 2)
    data = IOData(table[:, 0], table[::-1, 1], 0.5)
    assert data.u.dtype == float
    assert data.u.flags.c_contiguous
    np.testing.assert_array_equal(data.y[:, 0], np.arange(19, 0, -2))
    np.testing.assert_array_equal(data.t, 0.5 * np.arange(10))


def test_a_record_does_not_change_with_the_array_it_came_from():
    u = np.arange(4.0)
    data = IOData(u, u + 1, 1.0)
    u[:] = 0
    np.testing.assert_array_equal(data.u[:, 0], np.arange(4.0))


def test_quick_start_takes_off_the_mean_of_the_whole_record_and_retrend_gives_it_back():
    rng = np.random.default_rng(0)
    data = IOData(rng.normal(2, 1, 101), rng.normal(-5, 1, 101), 0.1)
    estimation, validation = quick_start(data)
    assert (estimation.N, validation.N) == (50, 51)
    whole = np.concatenate([estimation.y, validation.y])
    assert abs(whole.mean()) < 1e-12
    np.testing.assert_allclose(retrend(validation).u, data.u[50:], atol=1e-12)
    np.testing.assert_allclose(retrend(detrend(detrend(data))).y, data.y, atol=1e-12)


def test_split_and_detrend_refuse_nonsense():
    data = IOData(np.arange(5.0), np.arange(5.0), 1.0)
    with pytest.raises(InputError, match="between 0 and 1"):
        data.split(1.0)
    with pytest.raises(InputError, match="each part needs 2"):
        data.split(0.9)
    with pytest.raises(InputError, match="mean, linear, steady, none"):
        detrend(data, "cubic")

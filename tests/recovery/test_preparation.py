"""Preparation: every step against scipy or numpy, and its Python lines against what it does."""

import numpy as np
import pytest
from scipy import signal

import sysid
from sysid import InputError, IOData
from sysid.data.preparation import Preparation, between

RNG = np.random.default_rng(3)


def record(N=400, Ts=0.05, lost=()):
    """Two inputs, one of them in steps; two outputs with offsets, some of them missing."""
    u = np.column_stack([1.0 + np.repeat(RNG.normal(size=N // 8), 8), RNG.normal(size=N)])
    y = np.column_stack([signal.lfilter([0.2], [1, -0.8], u[:, 0]), signal.lfilter([0.5], [1, -0.5], u[:, 1])])
    missing = np.zeros(y.shape, dtype=bool)
    missing[list(lost), 1] = True
    return IOData(u, y + np.array([3.0, -7.0]), Ts, missing=missing)


TWO = IOData.merge(record(lost=(40, 41, 200, 201, 202, 203)), record(N=320))
ALL = (
    Preparation(),
    Preparation(start=1.0, stop=14.0),
    Preparation(stop=9.99),
    Preparation(missing="fill"),
    Preparation(resample=0.1),
    Preparation(resample=0.02),
    Preparation(filter=(0.1, 3.0)),
    Preparation(filter=(None, 2.5)),
    Preparation(filter=(0.2, None)),
    *(Preparation(detrend=kind) for kind in ("mean", "linear", "none")),
    Preparation(0.5, 15.0, "fill", 0.1, (0.05, 4.0), "mean"),
)


@pytest.mark.parametrize("chosen", ALL, ids=str)
def test_the_lines_of_python_do_the_same_to_the_bit(chosen):
    told = {"sysid": sysid, "data": TWO}
    exec("\n".join(chosen.code()), told)
    got, want = told["data"], chosen.apply(TWO)
    for name in ("u", "y", "u_offset", "y_offset"):
        assert np.array_equal(getattr(got, name), getattr(want, name)), name
    assert (got.Ts, got.lengths) == (want.Ts, want.lengths)
    assert np.array_equal(got.observed, want.observed)
    assert Preparation(start=2.0).code("z") == ["z = sysid.data.preparation.between(z, 2.0, None)"]


def test_a_range_counts_in_every_experiment_with_both_ends():
    got = between(TWO, 1.0, 14.0)
    want = [TWO.y[20:281], TWO.y[420:681]]  # samples 20 to 280 of each
    assert got.lengths == (261, 261)
    assert np.array_equal(got.y[got.observed], np.concatenate(want)[got.observed])
    assert between(TWO, 0.3, 0.35).lengths == (2, 2)  # 0.3 / 0.05 is a little below 6
    for a, b in ((30.0, None), (None, 0.01), (2.01, 2.04)):
        with pytest.raises(InputError, match="give a range inside it"):
            between(TWO, a, b)


def test_fill_puts_lines_into_short_gaps_alone():
    y = TWO.y.copy()
    y[40:42, 1] = np.interp([40, 41], [39, 42], TWO.y[[39, 42], 1])
    got = Preparation(missing="fill").apply(TWO)
    assert np.flatnonzero(got.missing[:, 1]).tolist() == [200, 201, 202, 203]
    assert np.array_equal(got.y, y)
    with pytest.raises(InputError, match="6 outputs are missing, the first at sample 40"):
        Preparation(missing="refuse").apply(TWO)


def test_resampling_is_that_of_scipy_with_the_mean_of_a_held_input():
    got = Preparation(resample=0.1).apply(TWO)
    parts = np.split(TWO.y, [400])
    want = np.concatenate([signal.resample_poly(part, 1, 2, padtype="line") for part in parts])
    np.testing.assert_allclose(got.y[got.observed], want[got.observed], rtol=1e-12)
    np.testing.assert_allclose(got.u, TWO.u.reshape(-1, 2, 2).mean(axis=1), rtol=1e-12)
    assert (got.Ts, got.lengths) == (0.1, (200, 160))


@pytest.mark.parametrize(
    ("band", "kind"), [((0.1, 3.0), "bandpass"), ((None, 2.5), "lowpass"), ((0.2, None), "highpass")], ids=str
)
def test_the_filter_keeps_the_band_that_is_named(band, kind):
    edges = [f for f in band if f is not None]
    sos = signal.butter(4, edges if len(edges) == 2 else edges[0], kind, fs=20.0, output="sos")
    got = Preparation(filter=band).apply(TWO)
    for name in ("u", "y"):
        parts = np.split(getattr(TWO, name), [400])
        want = np.concatenate([signal.sosfiltfilt(sos, part, axis=0) for part in parts])
        kept = got.observed if name == "y" else slice(None)
        np.testing.assert_allclose(getattr(got, name)[kept], want[kept], atol=1e-12)


def test_trends_are_those_of_numpy():
    mean = Preparation(detrend="mean").apply(TWO)
    seen = TWO.observed[:, 1]
    np.testing.assert_allclose(mean.y_offset, [TWO.y[:, 0].mean(), TWO.y[seen, 1].mean()])
    np.testing.assert_allclose(mean.u, TWO.u - TWO.u.mean(axis=0))
    line = Preparation(detrend="linear").apply(TWO)
    want = np.concatenate([signal.detrend(part, axis=0) for part in np.split(TWO.u, [400])])
    np.testing.assert_allclose(line.u, want, atol=1e-11)
    assert not line.u_offset.any()


def test_steady_is_the_level_before_the_first_movement():
    u = np.r_[np.full(30, 2.0), 5.0 * np.ones(70), -4.0 * np.ones(60)]
    y = 10.0 + signal.lfilter([0, 0.1], [1, -0.9], u - 2.0)
    noisy = y + 0.01 * np.random.default_rng(0).normal(size=160)
    got = Preparation(detrend="steady").apply(IOData(u, noisy, 0.1))
    assert got.u_offset[0] == 2.0
    assert got.y_offset[0] == noisy[:30].mean()
    np.testing.assert_allclose(got.y[:, 0], noisy - noisy[:30].mean())
    assert abs(y.mean() - 10.0) > 0.5  # its mean is another zero
    with pytest.raises(InputError, match=r"moves at sample 1 .*does not begin at rest"):
        Preparation(detrend="steady").apply(IOData(u[29:], noisy[29:], 0.1))
    later = IOData(u[34:], noisy[34:], 0.1)
    with pytest.raises(InputError, match=r"before the input first moves, at 6.6 s, the output goes from"):
        Preparation(detrend="steady").apply(later)


def test_options_name_the_steps_and_nothing_else():
    assert ALL[0].options() == ()
    assert ALL[-1].options() == (
        *("--range", "0.5:15", "--missing", "fill", "--resample", "0.1"),
        *("--filter", "0.05:4", "--detrend", "mean"),
    )
    assert Preparation(filter=(None, 2.5), start=1.5).options() == ("--range", "1.5:", "--filter", ":2.5")


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ({"missing": "guess"}, "mark, fill, split, refuse"),
        ({"detrend": "cubic"}, "mean, linear, steady, none"),
        ({"filter": (3.0, 1.0)}, "the filter goes from 3 to 1"),
        ({"start": 3.0, "stop": 1.0}, "the range goes from 3 to 1"),
        ({"resample": -1.0}, "resample is -1"),
    ],
    ids=str,
)
def test_values_that_make_no_sense(values, found):
    with pytest.raises(InputError, match=found):
        Preparation(**values)

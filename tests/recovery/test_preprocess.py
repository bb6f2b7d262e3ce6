"""Preprocessing against signals whose trend, spectrum, outliers and gaps are known."""

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import InputError, IOData
from sysid.base.poles import match
from sysid.data.preprocess import Trend, butterworth, detrend, fill, hampel, outliers, record, resample

T = np.arange(2000)


def sine(f, Ts, N=2000):
    return np.sin(2 * np.pi * f * Ts * np.arange(N))


# --- trends


def test_lines_with_kinks_come_off_whole_and_go_back():
    hinge = 0.3 + 0.01 * T - 0.03 * np.maximum(T - 700, 0) + 0.05 * np.maximum(T - 1500, 0)
    signal = np.random.default_rng(0).normal(size=2000)
    data = IOData(signal + 4.0, signal + hinge, 0.1, y_unit="V")
    trend = Trend.of(data, "linear", (700, 1500))
    flat = trend.remove(data)
    # What is left is the signal less its own chance trend: its four coefficients take 4/2000 of the variance.
    assert np.var(flat.y[:, 0] - signal) < 4 * 4 / 2000
    assert abs(flat.u.mean()) < 1e-12
    np.testing.assert_allclose(trend.restore(flat).y, data.y, atol=1e-12)
    np.testing.assert_allclose(trend.restore_output(flat.y[:, 0]), data.y[:, 0], atol=1e-12)
    assert "kinks at samples 700, 1500" in trend.sentence


def test_an_exact_trend_leaves_nothing():
    y = 5.0 - 0.002 * T + 0.01 * np.maximum(T - 900, 0)
    data = IOData(np.sin(T), y, 1.0)
    assert np.abs(Trend.of(data, "linear", (900,)).remove(data).y).max() < 1e-10
    assert np.abs(Trend.of(data, "linear").remove(data).y).max() > 1.0


def test_experiments_have_lines_of_their_own_and_missing_samples_do_not_count():
    up, down = 0.01 * T, 7 - 0.02 * T
    spoilt = down.copy()
    spoilt[300:400] = 1e6
    data = IOData.merge(IOData(np.sin(T), up, 1.0), IOData(np.cos(T), spoilt, 1.0, missing=(T >= 300) & (T < 400)))
    flat = Trend.of(data).remove(data)
    assert np.abs(flat.y[data.observed]).max() < 1e-9
    shifted = Trend.of(data, "mean")
    observed = np.concatenate([up, np.delete(down, np.arange(300, 400))])
    assert shifted.y[0, 0] == pytest.approx(observed.mean())
    np.testing.assert_allclose(detrend(data).y_offset, [observed.mean()])


def test_trends_that_make_no_sense():
    data = IOData(T, T, 1.0)
    for breaks in ((5, 3), (0,), (1999,), (5, 5)):
        with pytest.raises(InputError, match="breaks are"):
            Trend.of(data, "linear", breaks)
    with pytest.raises(InputError, match="mean, linear"):
        Trend.of(data, "cubic")
    with pytest.raises(InputError, match="the record it was fitted to"):
        Trend.of(data).remove(data.select(0, 100))


# --- filters


@pytest.mark.parametrize("causal", [False, True])
def test_a_filter_keeps_the_linear_model_between_u_and_y(causal):
    """Poles from the filtered record are those of the plant, while a drift of ten times the signal is gone."""
    rng = np.random.default_rng(1)
    u = rng.normal(size=4000)
    y = lfilter([0, 0.5, 0.2], [1, -1.5, 0.7], u)
    drift = 10 * y.std() * np.sin(2 * np.pi * np.arange(4000) / 4000)
    data = butterworth(IOData(u, y + drift, 0.1), 0.05, "high", causal=causal).data
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), data.select(500, 3500), starts=1)
    assert max(m.s_error for m in match(fit.poles, np.roots([1, -1.5, 0.7]), 0.1)) < 0.02


@pytest.mark.parametrize(("kind", "cutoff", "kept", "lost"), [
    ("low", 1.0, 0.1, 4.0), ("high", 1.0, 4.0, 0.1), ("band", (0.5, 2.0), 1.0, 4.5), ("stop", (0.5, 2.0), 4.5, 1.0),
])  # fmt: skip
def test_pass_and_stop(kind, cutoff, kept, lost):
    middle = slice(500, 1500)
    for f, passes in ((kept, True), (lost, False)):
        x = sine(f, 0.1)
        out = butterworth(IOData(x, 2 * x, 0.1), cutoff, kind, order=6).data
        for before, after in ((x, out.u[:, 0]), (2 * x, out.y[:, 0])):
            if passes:  # without delay: the very sine
                np.testing.assert_allclose(after[middle], before[middle], atol=0.02)
            else:
                assert np.abs(after[middle]).max() < 0.02


def test_causal_output_does_not_look_ahead_and_starts_settled():
    x = np.concatenate([np.full(100, 3.0), np.full(100, 5.0)])
    data = IOData(x, x, 0.1)
    causal = butterworth(data, 0.5, causal=True).data.y[:, 0]
    np.testing.assert_allclose(causal[:100], 3.0, atol=1e-9)
    assert np.abs(butterworth(data, 0.5).data.y[90:100, 0] - 3.0).max() > 0.01  # zero phase does


def test_filters_that_make_no_sense():
    data = IOData(np.sin(T), np.cos(T), 0.1)
    for kind, cutoff in (("low", 5.0), ("low", 0.0), ("band", 1.0), ("band", (2.0, 1.0)), ("low", (1.0, 2.0))):
        with pytest.raises(InputError, match="below 5 Hz"):
            butterworth(data, cutoff, kind)
    with pytest.raises(InputError, match="low, high, band, stop"):
        butterworth(data, 1.0, "notch")
    with pytest.raises(InputError, match="too short"):
        butterworth(data.select(0, 10), 1.0)
    assert "4 missing outputs" in butterworth(IOData(T, T, 0.1, missing=T < 4), 1.0).sentence


# --- another rate


@pytest.mark.parametrize("Ts", [0.02, 0.03, 0.04, 0.05, 0.015, 0.0125])
def test_slow_sines_survive_and_fast_ones_do_not_fold(Ts):
    """From 0.02 s: a sine at a tenth of the lower rate comes out at the new times; one above half of it vanishes."""
    base, coarse = 0.02, max(Ts, 0.02)
    slow, fast = 0.1 / coarse, 0.7 / coarse
    x = sine(slow, base)
    out = resample(IOData(x, 3 * x, base), Ts, input="filtered").data
    assert out.Ts == Ts
    t = out.t
    inside = (t > 4) & (t < 36)
    np.testing.assert_allclose(out.y[inside, 0], 3 * np.sin(2 * np.pi * slow * t[inside]), atol=0.02)
    if Ts > base:
        np.testing.assert_allclose(out.u[inside, 0], np.sin(2 * np.pi * slow * t[inside]), atol=0.01)
        y = resample(IOData(x, sine(fast, base), base), Ts).data.y[inside, 0]
        assert np.abs(y).max() < 0.01  # the anti-alias filter leaves less than 1 %


@pytest.mark.parametrize("Ts", [0.25, 0.15, 0.2, 0.05])
def test_a_held_input_keeps_its_integral_and_its_levels(Ts):
    u = np.repeat([1.0, -2.0, 0.5, 3.0], 30)
    out = resample(IOData(u, np.cumsum(u), 0.1), Ts, input="held").data
    assert np.sum(out.u) * Ts == pytest.approx(np.sum(u) * 0.1)
    assert set(np.round(np.unique(out.u), 12)) >= {1.0, -2.0, 0.5, 3.0}
    assert out.u.max() == 3.0


def test_a_model_of_the_resampled_record_has_the_same_s_poles():
    """Lag of 2 s, sampled at 0.05 s under held steps; at 0.2 s the model's pole in s is the same."""
    Ts, tau = 0.05, 2.0
    u = np.repeat(np.random.default_rng(2).normal(size=400), 40)
    a = np.exp(-Ts / tau)
    y = lfilter([0, 1 - a], [1, -a], u)
    data = resample(IOData(u, y, Ts), 0.2, input="held").data
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1), data, starts=1)
    assert np.log(fit.poles[0].real) / 0.2 == pytest.approx(-1 / tau, rel=0.01)


def test_missing_and_experiments_carry_over():
    missing = np.zeros(1000, dtype=bool)
    missing[500] = True
    one = IOData(np.sin(T[:1000]), np.cos(T[:1000]), 0.1, missing=missing)
    out = resample(IOData.merge(one, one.select(0, 501)), 0.2).data
    assert out.lengths == (500, 251)
    assert out.missing is not None
    np.testing.assert_array_equal(np.flatnonzero(out.missing[:500, 0]), [249, 250, 251])


def test_rates_that_make_no_sense():
    data = IOData(T, T, 0.1)
    with pytest.raises(InputError, match="within a factor of 1000"):
        resample(data, 101.0)
    with pytest.raises(InputError, match="positive number"):
        resample(data, -1.0)
    with pytest.raises(InputError, match="filtered, held"):
        resample(data, 0.2, "linear")
    with pytest.raises(InputError, match="shorter Ts"):
        resample(data.select(0, 3), 10.0)


# --- outliers


def test_false_alarms_of_the_hampel_rule_in_white_noise():
    """The rates its documentation states, from a million samples: 1 and 67 expected, Poisson."""
    noise = np.random.default_rng(3).normal(size=1_000_000)
    assert hampel(noise).sum() <= 6
    assert abs(hampel(noise, threshold=4.0).sum() - 67) < 4 * np.sqrt(67)


@pytest.mark.parametrize("size", [8.0, 20.0])
def test_outliers_are_found_and_little_else(size):
    """40 outliers of 2.4 and 6 times the spread of a lively signal with 1 % noise, over 20 seeds: 61 and 93 % found."""
    hit, false = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        clean = lfilter([0.02], [1, -1.9, 0.92], rng.normal(size=2000))
        clean *= 100 / clean.std()
        y = clean + rng.normal(size=2000)
        where = rng.choice(np.arange(10, 1990), 40, replace=False)
        y[where] += 30 * size * rng.choice([-1.0, 1.0], 40)
        found = outliers(IOData(np.sin(T), y, 1.0)).found[:, 0]
        truth = np.isin(T, where)
        hit.append(found[truth].mean())
        false.append(found[~truth].mean())
    assert np.mean(hit) > (0.9 if size > 10 else 0.6)
    assert np.mean(false) < 0.003


def test_a_signal_at_rest_that_a_converter_rounds_has_no_outliers():
    rng = np.random.default_rng(4)
    travel = np.clip(np.cumsum(np.repeat(rng.choice([-1.0, 1.0], 40), 50)) * 0.01, -1.5, 1.5)
    y = np.round((travel + 0.002 * rng.normal(size=2000)) / 0.005) * 0.005
    assert outliers(IOData(np.sin(T), y, 0.1)).found.sum() == 0


def test_bridging_and_marking():
    y = np.sin(T / 50)
    spoilt = y.copy()
    spoilt[[300, 301, 900]] += [5.0, -7.0, 4.0]
    data = IOData(np.cos(T / 50), spoilt, 1.0)
    marked, bridged = outliers(data), outliers(data, "interpolate")
    assert marked.indices == bridged.indices == ((300, 301, 900),)
    assert marked.data.missing is not None
    np.testing.assert_array_equal(np.flatnonzero(marked.data.missing[:, 0]), [300, 301, 900])
    assert bridged.data.missing is None
    np.testing.assert_allclose(bridged.data.y[:, 0], y, atol=1e-3)
    assert "3 of 2000 outputs" in marked.sentence
    with pytest.raises(InputError, match="missing, interpolate"):
        outliers(data, "drop")


# --- gaps


def test_short_gaps_are_filled_long_ones_stay_open():
    y = 0.5 * T[:100].astype(float)
    y[[10, 20, 21, 22]] = np.nan
    y[40:60] = np.nan
    y[99] = np.nan
    got = fill(y, 3)
    np.testing.assert_allclose(got.values[:40], 0.5 * T[:40])
    np.testing.assert_array_equal(np.flatnonzero(got.open), [*range(40, 60), 99])
    assert "4 of 25 missing samples filled" in got.sentence
    assert "2 gap(s) not filled, the longest with 20 samples from 40 (limit 3)" in got.sentence
    assert fill(T, 3).sentence == "no sample is missing"


def test_a_held_input_is_held():
    u = np.repeat([1.0, 4.0, -2.0], 5)
    lost = u.copy()
    lost[[5, 6, 14]] = np.nan
    expected = u.copy()
    expected[5:7] = 1.0  # the last value known
    np.testing.assert_array_equal(fill(lost, 2, hold=True).values, expected)


def test_a_record_with_gaps_is_identified_as_if_it_had_none():
    rng = np.random.default_rng(5)
    u = rng.normal(size=3000)
    y = lfilter([0, 0.5, 0.2], [1, -1.5, 0.7], u)
    y[500:900] = np.nan
    data, said = record(u, y, 0.1)
    assert "400 samples from 500" in said
    assert data.missing is not None
    assert data.missing.sum() == 400
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), data, starts=1)
    assert max(m.s_error for m in match(fit.poles, np.roots([1, -1.5, 0.7]), 0.1)) < 1e-6
    u[600:700] = np.nan
    with pytest.raises(InputError, match="u is missing from sample 600 to 699"):
        record(u, y, 0.1)


def test_gaps_that_make_no_sense():
    with pytest.raises(InputError, match="every sample"):
        fill(np.full(5, np.nan))
    with pytest.raises(InputError, match="one for each"):
        fill(T, missing=np.ones(3))


# --- numbers of a damaged session


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        ({"start": -1e308, "stop": -1e300}, "holds 0 sample"),
        ({"start": 1e300}, "holds 0 sample"),
        ({"resample": 1e-308}, "within a factor of 1000"),
        ({"resample": 5e-324}, "within a factor of 1000"),
        ({"filter": (1e-300, None)}, "from 5e-06 Hz to below 5 Hz"),
        ({"filter": (None, 1e-9)}, "from 5e-06 Hz to below 5 Hz"),
    ],
)
def test_steps_beyond_what_a_record_allows_are_a_sentence(steps, said):
    from sysid.data.preparation import Preparation

    data = IOData(sine(1.0, 0.1), sine(1.0, 0.1), 0.1)
    with pytest.raises(InputError, match=said):
        Preparation(**steps).apply(data)


def test_a_range_far_beyond_the_record_is_the_record():
    from sysid.data.preparation import between

    data = IOData(sine(1.0, 0.1), sine(1.0, 0.1), 0.1)
    assert between(data, -1e308, 1e308).N == data.N


@pytest.mark.parametrize("kind", ["low", "high"])
def test_the_lowest_cutoff_still_filters(kind):
    data = IOData(sine(1.0, 0.1) + 3.0, sine(1.0, 0.1) + 3.0, 0.1)
    found = butterworth(data, 5e-6, kind, causal=True).data.u[:, 0]
    expected = 3.0 + 0.0 * T if kind == "low" else data.u[:, 0] - data.u[0, 0]
    np.testing.assert_allclose(found, expected, atol=2e-2)

"""Regimes, shares of an error, frequency responses, repeatability and intervals, on records made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

import sysid
import twin
from sysid.base.errors import InputError
from sysid.joint.values import JointValue
from twin.compare import intervals
from twin.compare.alignment import Alignment
from twin.compare.comparison import LOG, MODEL, compare_log, compare_model
from twin.compare.departure import NAMES, by_regime, has_power, noise_of, outliers, regimes, repeat, spectrum
from twin.compare.effects import Knob
from twin.compare.intervals import Value, sandwich
from twin.compare.joints import Pair
from twin.compare.unseen import unseen
from twin.log import Log
from twin.report.compare import pair_row

TS = 0.05


def trapezes():
    """Up fast, rest, up slowly to a stop, there, down fast, rest: (y, the middle sample of each part)."""
    rates = [(1.0, 40), (0.0, 40), (0.2, 60), (0.0, 60), (-1.0, 60), (0.0, 40)]
    y = np.concatenate([[0.0], np.cumsum(np.concatenate([np.full(n, rate * TS) for rate, n in rates]))])
    edges = np.cumsum([0, *(n for _, n in rates)])
    return y, (edges[:-1] + edges[1:]) // 2


def test_each_part_of_a_record_is_in_its_regime():
    y, middles = trapezes()
    at = regimes(y, TS)
    names = [next(name for name in NAMES if at[name][k]) for k in middles]
    assert names == ["fast", "rest", "slow", "end stop", "fast", "end stop"]
    assert np.flatnonzero(at["reversal"])[0] == pytest.approx(200, abs=5)  # where motion down begins
    assert at["reversal"].sum() == 11  # 0.1 s before, the sample itself, 0.4 s after


def test_regimes_are_a_partition():
    y, _ = trapezes()
    y = y + 0.01 * np.random.default_rng(0).standard_normal(len(y))
    at = regimes(y, TS)
    assert tuple(at) == NAMES
    np.testing.assert_array_equal(np.sum(list(at.values()), axis=0), 1)


def test_shares_of_an_error_made_by_hand():
    at = {
        "rest": np.array([1, 1, 0, 0], bool),
        "slow": np.array([0, 0, 1, 0], bool),
        "fast": np.array([0, 0, 0, 1], bool),
    }
    at["reversal"] = np.zeros(4, bool)
    found = {regime.name: regime for regime in by_regime(np.array([3.0, 4.0, 5.0, 0.0]), at)}
    assert found["rest"].rms == pytest.approx(np.sqrt(12.5))
    assert found["rest"].of_error == pytest.approx(0.5)
    assert (found["rest"].share, found["slow"].share) == (0.5, 0.25)
    assert found["slow"].rms == 5.0
    assert found["fast"].of_error == 0.0
    assert (found["reversal"].rms, found["reversal"].share) == (0.0, 0.0)


def test_a_reading_far_off_is_an_outlier_and_a_step_of_the_error_is_none():
    e, moves = 1e-3 * np.random.default_rng(0).standard_normal(400) + 0.05 * (np.arange(400) > 200), np.ones(400, bool)
    assert outliers(e, 1e-3, TS, moves) == ()
    e += 0.4
    rest = float(np.sum(e**2))
    e[300] += 0.5
    (found,) = outliers(e, 1e-3, TS, moves)
    assert (found.time, found.size) == (pytest.approx(300 * TS), pytest.approx(0.5, abs=5e-3))
    assert found.of_error == pytest.approx(1.0 - rest / np.sum(e**2), rel=0.02)


def test_steps_of_a_converter_in_motion_are_no_outliers():
    """At rest the readings do not flicker; in motion each is rounded to a step of 8 times what noise seems to be."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        moves = np.arange(400) > 250
        way = np.cumsum(moves * rng.uniform(0.2, 0.6)) + 0.2 * moves * rng.standard_normal(400)
        e = 0.01 * (np.round(way) - way) + 0.0012 * rng.standard_normal(400)
        assert outliers(e, 0.0012, TS, moves) == ()


@pytest.mark.parametrize(
    ("u", "power"),
    [(np.full(800, 6.1), False), (np.linspace(-1.0, 1.0, 800), False), (np.sign(np.arange(800) - 9), True)],
)
def test_an_input_that_does_not_change_has_no_power(u, power):
    assert has_power(np.asarray(u, dtype=float)) == power


def test_what_a_log_leaves_out_is_said():
    way, rng = np.linspace(0.1, 0.6, 200), np.random.default_rng(0)
    once, both = 6.0 * np.ones(200), np.concatenate([way, way[::-1], way, way[::-1]])
    assert unseen(once, way, TS, (-0.2, 0.6), 12.0) == (
        "the lower end (17 deg away)",
        "voltages other than 6.00 V",
        "downward motion",
    )
    u = np.repeat([12.0, -12.0, 12.0, -12.0], 200)
    assert unseen(u, both + 1e-3 * rng.standard_normal(800), TS, (0.1, 0.6), 12.0) == ()
    left_out = unseen(0.5 * u[:400], both[:400], TS, (0.1, 0.6), 12.0)
    assert left_out == ("voltages beyond 6.00 V of 12.0 V", "more than one reversal")


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_noise_is_found_beside_motion(noise):
    y, _ = trapezes()
    long = np.concatenate([y, y[-1] - y + y[0], y])
    found = noise_of(long + noise * np.random.default_rng(4).standard_normal(len(long)))
    assert found == pytest.approx(noise, rel=0.15)


def test_noise_of_rounding_is_a_twelfth_of_a_step():
    """A slow ramp rounded to steps, with as much noise as a step: variance of both."""
    rng, step = np.random.default_rng(2), 0.01
    y = np.round((1e-4 * np.arange(4000) + step * rng.standard_normal(4000)) / step) * step
    assert noise_of(y) == pytest.approx(step * np.sqrt(1 + 1 / 12), rel=0.06)


@pytest.mark.parametrize("periodic", [False, True])
def test_frequency_response_of_a_known_filter(periodic):
    rng = np.random.default_rng(3)
    u = np.tile(rng.choice([-1.0, 1.0], 200), 10) if periodic else rng.choice([-1.0, 1.0], 2000)
    y = lfilter([0.5], [1.0, -0.5], u) + 0.05 * rng.standard_normal(2000)
    found = spectrum(u, y, TS)
    assert ("periods" in found.method) == periodic
    _, true = freqz([0.5], [1.0, -0.5], 2 * np.pi * found.frequency * TS)
    inside = np.abs(found.G - true) <= found.radius
    assert inside.mean() == pytest.approx(0.95, abs=0.05)
    if periodic:  # |U|^2 is 200 a period on average, noise 200 times its variance: 0.05 / 3 after nine periods
        assert np.median(found.radius) == pytest.approx(np.sqrt(-np.log(0.05)) * 0.05 / 3, rel=0.25)
    size, low, high = found.magnitude
    np.testing.assert_allclose(high - size, found.radius)
    assert (low >= 0).all()


def test_intervals_hold_under_coloured_residuals():
    """A mean and a slope in first-order noise: the sandwich holds, the white formula would not."""
    rng, n, hits, white = np.random.default_rng(7), 800, [], []
    t = np.linspace(-1, 1, n)
    X = np.column_stack([np.ones(n), t])
    for _ in range(200):
        e = lfilter([1.0], [1.0, -0.8], rng.standard_normal(n))
        beta, *_ = np.linalg.lstsq(X, e, rcond=None)
        rest = e - X @ beta
        hits.append(np.abs(beta) <= 1.96 * sandwich(X, rest))
        white.append(np.abs(beta) <= 1.96 * np.std(rest) * np.sqrt(np.diag(np.linalg.inv(X.T @ X))))
    assert np.mean(hits) > 0.9
    assert np.mean(white) < 0.6


@pytest.mark.parametrize(("bounds", "known"), [((-0.1, 0.1), False), ((-0.1, 9.0), True), ((-9.0, 9.0), True)])
def test_an_interval_from_bound_to_bound_is_none(bounds, known, monkeypatch):
    J = np.column_stack([np.zeros(400), np.full(400, 0.1)])
    monkeypatch.setattr(intervals, "differences", lambda *_: [J])
    monkeypatch.setattr(intervals, "stiffness", lambda *_: np.zeros(1))
    knob = Knob("delay", "s", 0.0, *bounds, 1.0)
    trials = SimpleNamespace(knobs={"delay": knob})
    search = SimpleNamespace(knobs=("delay",), free=("delay",), state={}, last=None)
    monkeypatch.setattr(intervals, "replace", lambda search, **_: search)
    e = np.random.default_rng(0).standard_normal(400)
    (found,) = intervals.values(trials, search, e)
    assert (found.low is not None) == known


def test_what_a_record_does_not_show_has_no_interval():
    X = np.column_stack([np.ones(100), np.zeros(100), np.linspace(0, 1, 100)])
    std = sandwich(X, np.random.default_rng(0).standard_normal(100))
    assert np.isinf(std[1])
    assert np.isfinite(std[[0, 2]]).all()
    twice = np.column_stack([X[:, 0], X[:, 2], X[:, 2]])
    assert np.isinf(sandwich(twice, np.random.default_rng(0).standard_normal(100))[1:]).all()


def logs_of_one_input(drift=0.0, offset=0.0, noise=0.01):
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-5, 5, 40), 20)
    y = 0.1 * np.cumsum(u) * TS
    one = y + noise * rng.standard_normal(800) + offset + drift * TS * np.arange(800)
    return Log(u, one, TS, joint="thigh"), Log(u, y + noise * rng.standard_normal(800), TS, joint="thigh")


def test_repeatability_finds_offset_drift_and_spread():
    one, two = logs_of_one_input(drift=1e-3, offset=0.05)
    found = repeat(one.io(), two.io(), "two")
    assert found.drift[1] < 1e-3 < found.drift[2]
    assert found.drift[2] - found.drift[1] < 3e-4
    assert found.drifts
    assert found.offset[1] < 0.05 + 1e-3 * TS * 399.5 < found.offset[2]
    assert found.spread == pytest.approx(0.01 * np.sqrt(2), rel=0.1)
    assert found.by_noise == pytest.approx(found.spread, rel=0.2)


def test_two_logs_without_a_drift_have_none():
    one, two = logs_of_one_input()
    assert not repeat(one.io(), two.io(), "two").drifts
    found = compare_log(one, two, "thigh", "two.csv")
    assert found.kind == LOG
    assert found.rms == pytest.approx(0.01 * np.sqrt(2), rel=0.1)


def test_logs_of_different_inputs_are_refused():
    one, two = logs_of_one_input()
    other = Log(np.where(np.arange(800) == 300, 9.0, two.u), two.y, TS, joint="thigh")
    with pytest.raises(InputError, match=r"inputs differ: .* at 15 s"):
        compare_log(one, other, "thigh", "two.csv")
    with pytest.raises(InputError, match="sampling times"):
        compare_log(one, Log(two.u, two.y, 0.1, joint="thigh"), "thigh", "two.csv")


def test_a_model_beside_the_log_it_was_fitted_to():
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-1.0, 1.0, 80), 5)
    y = lfilter([0.0, 1.0], [1.0, -0.8], u) + 0.01 * rng.standard_normal(400)
    log = Log(u, y, TS, joint="thigh")
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1), log.io())
    found = compare_model(log, "thigh", fit, "model.json")
    assert found.kind == MODEL
    assert found.rms == pytest.approx(0.01, rel=0.1)
    assert found.tests is not None
    assert found.tests.white
    assert found.fit == pytest.approx(fit.fit_percent(log.io()), abs=0.05)
    assert found.as_dict()["verdict"] is None
    with pytest.raises(InputError, match=r"sampling time of 0\.05 s and the log has 0\.1 s"):
        compare_model(Log(u, y, 0.1, joint="thigh"), "thigh", fit, "model.json")


def test_a_short_log_is_refused():
    with pytest.raises(InputError, match="more than 50"):
        twin.compare.compare(Log(np.zeros(50), np.zeros(50), TS, joint="thigh"), "thigh")


def value(number, half=None, why=""):
    limits = (None, None) if half is None else (number - half, number + half)
    return JointValue("end_high", number, *limits, "rad", half is not None, why)


@pytest.mark.parametrize(
    ("log", "other", "says"),
    [
        (value(1.0, 0.1), value(1.3, 0.1), "yes"),  # 0.3 is more than 0.14
        (value(1.0, 0.1), value(1.1, 0.1), "no"),
        (value(1.0, 0.1), value(1.3, why="not reached: beyond 60 deg (it rests nowhere)"), "cannot tell"),
    ],
)
def test_values_of_both_sides_differ_only_where_both_are_told(log, other, says):
    cells = pair_row(Pair("end_high", log, other))
    assert cells[-1] == says
    if says == "cannot tell":
        assert cells[4:6] == ("–", "not reached: beyond 60 deg")


def test_an_alignment_proposes_what_differs_beyond_its_interval():
    late, right = Value("delay", 0.05, 0.03, 0.07, "s"), Value("delay", 0.01, -0.01, 0.03, "s")
    same, unknown = Value("gear", 1.02, 0.99, 1.05, ""), Value("offset", 0.3, None, None, "rad")
    start = Value("start", 0.0, None, None, "rad")
    assert Alignment("", late, same, unknown, start).sentences()[-1].endswith("--align delay would.")
    assert "nothing is to be applied" in Alignment("", right, same, unknown, start).sentences()[-1]

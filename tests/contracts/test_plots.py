"""Figures show the numbers they are given: axes carry units, bands their edges, bars their verdict."""

import re
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

import sysid
from sysid import plots
from sysid.data import frequency_data
from sysid.data.preprocess import detrend
from sysid.diagnosis.residuals import higher_order_tests
from sysid.drawing.plotly import plotly
from sysid.plots.residual_tests import residuals_figure
from sysid.plots.static_maps import maps_figure
from sysid.report.verdict import left_in_words
from sysid.structures import process
from sysid.systems import system
from sysid.uncertainty import bands, curves, intervals, responses
from sysid.uncertainty.information import UNEXCITED

pytestmark = pytest.mark.pixels

mpl.use("Agg")


@pytest.fixture(scope="module")
def case():
    plant, rng = system("textbook"), np.random.default_rng(1)
    data = plant.record(800, 0.05, rng)
    data = sysid.IOData(data.u, data.y, plant.Ts, "voltage", "angle", "V", "rad")
    fit = sysid.fit(plant.chain, data, search="lm", starts=1)
    return data, fit, sysid.information(fit, data)


def shaded(axes):
    """Lowest and highest point of the shaded band."""
    path = axes.collections[0].get_paths()[0].vertices
    return path[:, 1].min(), path[:, 1].max()


def test_responses_show_the_band_and_the_units(case):
    *_, info = case
    band = responses.step(info)
    axes = plots.step(band, y_unit="rad", u_unit="V")
    assert axes.get_xlabel() == "time after the step [s]"
    assert axes.get_ylabel() == "output [deg/V]"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), np.degrees(band.value))
    assert shaded(axes) == pytest.approx(np.degrees((band.lower.min(), band.upper.max())))
    assert "95 %" in axes.get_legend().get_texts()[1].get_text()
    assert plots.impulse(responses.impulse(info)).lines[0].get_ydata()[0] == 0.0  # nk = 1


def test_bode_keeps_the_curve_in_sight(case):
    *_, info = case
    response = responses.frequency(info)
    magnitude, phase = plots.bode(response)
    assert (magnitude.get_xscale(), magnitude.get_yscale()) == ("log", "log")
    low, high = magnitude.get_ylim()
    assert low < response.magnitude.value.min()
    assert high < 10 * response.magnitude.value.max()
    assert phase.get_ylabel() == "phase [deg]"


def test_a_magnitude_without_a_bound_is_infinite_and_quiet(case, monkeypatch):
    real = responses.band

    def wide(info, x, value, gradient, level):
        found = real(info, x, value, gradient, level)
        return replace(found, lower=found.lower - 1e4, upper=found.upper + 1e4)

    monkeypatch.setattr(responses, "band", wide)
    magnitude = responses.frequency(case[2]).magnitude
    assert np.all(np.isinf(magnitude.upper))
    assert np.all(magnitude.lower == 0.0)


@pytest.mark.parametrize(
    ("white", "p", "words"),
    [
        (True, 0.5, "the input's effect is captured; what is left is noise"),
        (True, 0.0, "what is left still depends on the input"),
        (False, 0.5, "the input's effect is captured; what is left is noise with memory"),
        (False, 0.0, "what is left still depends on the input"),
    ],
)
def test_residuals_are_told_in_words_that_cannot_be_read_two_ways(white, p, words):
    rng = np.random.default_rng(3)
    tests = sysid.residual_tests(rng.normal(size=500), rng.normal(size=500))
    own = np.eye(26)[0] if white else np.ones(26)
    tests = replace(tests, autocorrelation=own, independence_p=p)
    assert left_in_words(tests) == words
    assert tests.verdicts[0] == ("white" if white else "coloured")
    assert tests.verdicts[1].endswith("(p = 0.5)" if p else "(p < 0.0001)")


def test_the_rule_of_whiteness_is_the_one_that_decides():
    rng = np.random.default_rng(3)
    tests = sysid.residual_tests(rng.normal(size=500), rng.normal(size=500))
    most, n, factor = re.search(r"at most (\d+) of (\d+) .* beyond ([\d.]+) times", tests.rule).groups()
    assert int(n) == 25
    for count, size, white in (
        (int(most), 1.01, True),
        (int(most) + 1, 1.01, False),
        (1, 0.99, True),
        (1, 1.01, False),
    ):
        r = np.eye(26)[0]
        r[1 : count + 1] = tests.whiteness_bound * size * (float(factor) if count == 1 else 1.0)
        assert replace(tests, autocorrelation=r).white == white, (count, size)


def test_pole_map_draws_ellipses_for_pairs_and_bars_for_real_roots(case):
    *_, info = case
    poles, zeros = intervals.poles(info), intervals.zeros(info)
    axes = plots.pole_zero(poles, zeros)
    a, b, tilt = poles[0].ellipse()
    ellipse = axes.patches[0]
    assert (ellipse.width, ellipse.height) == pytest.approx((2 * a, 2 * b))
    assert ellipse.angle == pytest.approx(np.degrees(tilt))
    assert len(axes.patches) == 2  # the zero is real
    near = plots.pole_zero(poles, zoom=0)
    assert np.diff(near.get_xlim())[0] == pytest.approx(6 * a)


def test_maps_say_which_scale_they_are_in(case):
    *_, info = case
    first, last = (plots.static_curve(c) for c in curves.curves(info))
    assert "own scale" in first.get_title("left")
    assert first.get_xlabel() == "u [V]"
    assert "normalised scale" in last.get_title("left")
    assert last.get_ylabel() == "y [deg]"
    assert any(t.get_text() == "no nonlinearity" for t in last.get_legend().get_texts())


def test_a_map_without_a_band_is_told_to_readers_of_either_figure(case):
    curve = curves.curves(case[-1])[0]
    unexcited = replace(curve, band=replace(curve.band, note=UNEXCITED))
    assert maps_figure([unexcited]).said == [f"The record does not excite all of the {curve.role} map."]


def test_simulated_output_with_band_over_data(case):
    data, _, info = case
    band = bands.linear(info)
    axes = plots.simulated(band, data)
    np.testing.assert_allclose(axes.lines[0].get_ydata(), np.degrees(data.y[:, 0]))
    assert axes.get_ylabel() == "angle [deg]"
    assert shaded(axes) == pytest.approx(np.degrees((band.lower.min(), band.upper.max())))
    drawn = plots.simulated(bands.monte_carlo(info, draws=40), data)
    assert "40 draws" in drawn.get_legend().get_texts()[2].get_text()


def test_residual_bars_and_comparison(case):
    data, fit, _ = case
    tests = fit.residual_tests(data)
    first, second = plots.residual_tests(tests)
    assert "white" in first.get_title("left")
    assert "independent" in second.get_title("left")
    e = fit.residuals(data)
    higher = higher_order_tests(e, data.u[-len(e) :, 0])
    for axes, test in zip(plots.higher_order_tests(higher), higher.tests, strict=True):
        low, high = axes.get_ylim()
        assert low < min(-test.bound, test.correlation.min())
        assert high > max(test.bound, test.correlation.max())
    axes = plots.comparison(sysid.compare(data, fit))
    assert f"d {fit.criteria.d}" in axes.texts[0].get_text()
    assert axes.patches[0].get_width() == pytest.approx(fit.fit_percent(data))


def test_an_axes_of_ones_own_is_used(case):
    from matplotlib.figure import Figure

    own = Figure().subplots()
    assert plots.steady_state(intervals.steady_state(case[2]), own, "V", "rad") is own
    assert own.get_xlabel() == "u [V]"


def response_fit():
    w = np.geomspace(0.1, 10.0, 12)
    return sysid.fit(process("P1"), frequency_data(w, 2.0 / (1.0 + 1j * w) + 0.01 * np.exp(1j * w**2)))


def drawings(case):
    """What each kind of figure is given here, and how many panels that makes."""
    data, fit, info = case
    half, other = data.select(0, 400), data.select(400, 800)
    runs = [plots.Run(part, fit.simulate(part), 90.0) for part in (half, other)]
    e = fit.residuals(data)
    higher = higher_order_tests(e, data.u[-len(e) :, 0])
    maps = curves.curves(info)
    return {
        "bode": ((responses.frequency(info),), 2),
        "usual": (([("loss", (0.2, 0.3), (0.1, 0.1), "open")],), 1),
        "close_ups": ((data, fit.simulate(data)), 2),
        "comparison": ((sysid.compare(data, fit),), 1),
        "fitted": ((data, fit.simulate(data), [90.0]), 2),
        "free_run": ((runs[0], runs[1], runs[1]), 4),
        "free_runs": ((runs,), 2),
        "higher_order_tests": ((higher,), len(higher.tests)),
        "impulse": ((responses.impulse(info),), 1),
        "parts": ((half, other), 2),
        "pole_zero": ((fit.poles, fit.zeros), 1),
        "pole_zero_map": ((np.array([0.97]), ()), 2),
        "record": ((data,), 2),
        "residual_tests": ((fit.residual_tests(data),), 2),
        "response_fit": ((response_fit(),), 3),
        "simulated": ((bands.linear(info), data), 1),
        "static_curve": ((maps[0],), 1),
        "static_maps": ((maps,), len(maps)),
        "steady_state": ((intervals.steady_state(info),), 1),
        "step": ((responses.step(info),), 1),
    }


@pytest.mark.parametrize("name", plots.TABLE)
def test_every_kind_draws_into_given_axes_or_its_own_alike_and_leaves_settings_alone(case, name):
    from matplotlib.figure import Figure

    given = drawings(case)
    assert name in given, f"say in drawings() of tests/contracts/test_plots.py what {name} is given"
    arguments, n = given[name]
    before = dict(mpl.rcParams)
    own = plots.TABLE[name](*arguments)
    single = not isinstance(own, list)
    axes = list(Figure().subplots(n, 1, squeeze=False)[:, 0])
    drawn = plots.TABLE[name](*arguments, axes=axes[0] if single else axes)
    assert dict(mpl.rcParams) == before
    assert (drawn is axes[0]) if single else all(a is b for a, b in zip(drawn, axes, strict=True))
    for mine, theirs in zip([own] if single else own, axes, strict=True):
        assert len(mine.lines) == len(theirs.lines)
        for a, b in zip(mine.lines, theirs.lines, strict=True):
            np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())
        assert mine.get_title("left") == theirs.get_title("left")
        assert not mine.get_title("center")
        for label in (mine.get_xlabel(), mine.get_ylabel()):
            assert "[rad]" not in label
            assert "[" in label or not any(word in label for word in ("angle", "voltage", "time")), label
    with pytest.raises(sysid.InputError, match=f"9 axes are given and there are {n} panels"):
        plots.TABLE[name](*arguments, axes=[axes[0]] * 9)


def test_a_response_of_an_angle_to_an_angle_has_the_same_number_in_degrees(case):
    band = responses.step(case[2])
    axes = plots.step(band, y_unit="rad", u_unit="rad")
    np.testing.assert_allclose(axes.lines[0].get_ydata(), band.value)
    assert axes.get_ylabel() == "output [deg/deg]"
    per_degree = plots.step(band, y_unit="V", u_unit="rad", y_name="level")
    np.testing.assert_allclose(per_degree.lines[0].get_ydata(), band.value * np.pi / 180)
    assert per_degree.get_ylabel() == "level [V/deg]"


def test_roots_without_intervals_have_no_regions_and_far_ones_are_counted():
    axes = plots.pole_zero(np.array([0.5, 3.0, -0.2 + 2j]), [0.9], references={"truth": np.array([4.0, 0.1])})
    assert not axes.patches
    assert [t.get_text() for t in axes.texts] == ["3 beyond the frame"]
    assert {t.get_text() for t in axes.get_legend().get_texts()} == {"pole", "zero", "truth"}
    assert len(plots.pole_zero_map(np.array([0.5]))) == 1
    left, right = plots.pole_zero_map(np.array([0.5]), references={"truth": np.array([0.97])})
    assert right.get_xlim()[0] < 0.97 < right.get_xlim()[1] < left.get_xlim()[1]


def test_a_free_run_shows_both_parts_their_error_and_one_step_ahead_in_degrees():
    u, t = np.zeros(50), np.arange(50)
    parts = [sysid.IOData(u, np.sin(0.1 * t + k), 0.1, y_name="angle", y_unit="rad") for k in (0, 1)]
    runs = [plots.Run(part, part.y[:, 0] + 0.1 * (k + 1), 80.0 + k) for k, part in enumerate(parts)]
    rows = plots.free_run(*runs, plots.Run(parts[1], np.full(50, 0.5), 99.0))
    np.testing.assert_allclose(rows[0].lines[1].get_ydata(), np.degrees(np.sin(0.1 * t) + 0.1))
    np.testing.assert_allclose(rows[2].lines[0].get_ydata(), np.degrees(-0.2))
    np.testing.assert_allclose(rows[3].lines[1].get_ydata(), np.degrees(0.5))
    labels = [row.get_legend().get_texts()[1].get_text() for row in (rows[0], rows[1], rows[3])]
    assert labels == ["free run, fit 80.00 %", "free run, fit 81.00 %", "one step ahead, fit 99.00 %"]
    wild = plots.free_runs([plots.Run(parts[0], 1e6 * np.ones(50), -1e9)], seconds=2.0)
    (ax,) = wild
    assert ax.get_ylim()[1] > np.degrees(1e6)  # a run that leaves the data is seen whole, and does not flatten them
    low, high = ax.transData.transform([(0.0, -np.degrees(1.0)), (0.0, np.degrees(1.0))])[:, 1]
    assert high - low > 0.4 * ax.bbox.height
    assert len(wild[0].lines[0].get_xdata()) == 20


def test_a_record_is_shown_as_recorded_and_its_parts_after_each_other():
    data = detrend(sysid.IOData(np.arange(10.0), np.ones(10) + np.arange(10), 0.5, "u", "y", "V", "rad"))
    top, bottom = plots.record(data)
    np.testing.assert_allclose(top.lines[0].get_ydata(), np.arange(10.0))
    np.testing.assert_allclose(bottom.lines[0].get_ydata(), np.degrees(1 + np.arange(10.0)))
    top, _ = plots.parts(data.select(0, 6), data.select(6, 10))
    np.testing.assert_allclose(top.lines[1].get_xdata(), 3.0 + 0.5 * np.arange(4))
    np.testing.assert_allclose(top.lines[1].get_ydata(), np.arange(6.0, 10.0))  # not as detrended


def test_close_ups_hold_the_first_peaks():
    t = np.arange(400) * 0.05
    y = np.sin(2 * np.pi * t / 5.0)  # up at 1.25 s, down at 3.75 s, four times
    up, down = plots.close_ups(sysid.IOData(np.zeros(400), y, 0.05), y)
    for ax, centre in ((up, 1.25), (down, 3.75)):
        shown = ax.lines[0].get_xdata()
        assert shown[0] < centre < shown[-1]
        assert shown[-1] - shown[0] < 4.0


def test_bars_of_residuals_leave_out_lag_zero_and_colour_those_outside():
    rng = np.random.default_rng(3)
    e = rng.normal(size=500)
    e[1:] += 0.8 * e[:-1]
    tests = sysid.residual_tests(e, rng.normal(size=500))
    top, bottom = plots.residual_tests(tests)
    lags = np.concatenate([line.get_xdata() for line in top.lines if line.get_marker() == "o"])
    assert sorted(lags) == list(range(1, 26))
    outside = next(line for line in top.lines if line.get_label() == "beyond chance")
    assert len(outside.get_xdata()) == tests.whiteness_outside > 0
    assert top.get_title("left").endswith("coloured")
    assert tests.verdicts[1] in str(plotly(residuals_figure(tests))["layout"])
    assert bottom.get_title("left").endswith(f"all lags together: independent (p = {tests.independence_p:.2g})")
    assert not [line for line in bottom.lines if line.get_label() == "beyond chance"]


@pytest.mark.parametrize(("p", "size", "red"), [(0.5, 0.2, 0), (0.0, 0.2, 1), (0.0, 0.01, 51)])
def test_red_bars_of_residuals_with_the_input_stand_where_the_words_say_that_they_depend_on_it(p, size, red):
    tests = sysid.residual_tests(*np.random.default_rng(3).normal(size=(2, 500)))
    tests = replace(tests, cross_correlation=np.where(tests.cross_lags == 3, size, 0.01), independence_p=p)
    _, bottom = plots.residual_tests(tests)
    assert sum(len(line.get_xdata()) for line in bottom.lines if line.get_label() == "beyond chance") == red


def test_lags_outside_beside_residuals_that_are_independent_are_explained():
    rng = np.random.default_rng(22)
    u, e = np.repeat(rng.standard_normal(20), 20), np.convolve(rng.standard_normal(400), np.ones(15), "same")
    tests = sysid.residual_tests(e, u)
    assert tests.independent
    note = residuals_figure(tests).panels[1].note
    assert note.startswith(f"{tests.independence_outside} lags leave the bound of one lag: neighbours do so together")


def test_steady_state_and_gain_are_shown_in_degrees(case):
    band = intervals.steady_state(case[2])
    axes = plots.steady_state(band, u_unit="V", y_unit="rad")
    np.testing.assert_allclose(axes.lines[0].get_xydata(), np.column_stack([band.x, np.degrees(band.value)]))
    assert shaded(axes) == pytest.approx(np.degrees((band.lower.min(), band.upper.max())))
    response = responses.frequency(case[2])
    magnitude, phase = plots.bode(response, y_unit="rad", u_unit="V")
    np.testing.assert_allclose(magnitude.lines[0].get_ydata(), np.degrees(response.magnitude.value))
    np.testing.assert_allclose(phase.lines[0].get_ydata(), response.phase.value)
    assert magnitude.get_ylabel() == "magnitude [deg/V]"
    (output,) = (c for c in curves.curves(case[2]) if c.role == "output")
    np.testing.assert_allclose(plots.static_curve(output).lines[0].get_ydata(), np.degrees(output.band.value))

"""Figures show the numbers they are given: axes carry units, bands their edges, bars their verdict."""

import matplotlib as mpl
import numpy as np
import pytest

import sysid
from sysid import plots
from sysid.systems import system
from sysid.uncertainty import bands, curves, intervals, responses

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
    assert axes.get_ylabel() == "output [deg per V]"
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
    for axes in plots.higher_order_tests(sysid.higher_order_tests(e, data.u[-len(e) :, 0])):
        low, high = axes.get_ylim()
        assert low == -high
    axes = plots.comparison(sysid.compare(data, fit))
    assert f"d {fit.criteria.d}" in axes.texts[0].get_text()
    assert axes.patches[0].get_width() == pytest.approx(fit.fit_percent(data))


def test_an_axes_of_ones_own_is_used(case):
    from matplotlib.figure import Figure

    own = Figure().subplots()
    assert plots.steady_state(intervals.steady_state(case[2]), own, "V", "rad") is own
    assert own.get_xlabel() == "u [V]"

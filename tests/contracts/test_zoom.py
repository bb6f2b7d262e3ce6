"""Zoomable figures: what is drawn is what was computed, nothing is cut off, and axes name their units."""

import base64
import json
import re
from dataclasses import replace
from html import unescape
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import shown
from plotly import graph_objects

import sysid
from sysid.base import style
from sysid.base.quantities import display_quantity
from sysid.data.record import IOData
from sysid.diagnosis.residuals import residual_tests
from sysid.drawing.departure import departure
from sysid.drawing.plotly import plotly
from sysid.joint.values import JointValue
from sysid.plots import Run, free_run, free_runs
from sysid.plots.free_runs import runs_figure
from sysid.plots.pole_zero import roots_figure
from sysid.plots.records import Signal, lines_figure, parts_figure, record_figure, stack_figure
from sysid.plots.residual_tests import residuals_figure
from sysid.plots.responses import bode_figure, step_figure
from sysid.plots.static_maps import maps_figure
from sysid.report.figures import joined_figure
from sysid.report.joint import parts_figure as parts_of_joint
from sysid.report.joint import values_figure
from sysid.report.page import element
from sysid.report.sections import undetermined_in_words, value_cells
from sysid.uncertainty import responses
from sysid.uncertainty.curves import curves
from sysid.uncertainty.information import information
from sysid.uncertainty.intervals import poles
from sysid.workflow.results import OneStep

pytestmark = pytest.mark.pixels

DEG = 180.0 / np.pi


@pytest.fixture(scope="module")
def data():
    """y_t = 0.8 y_{t-1} + tanh(u_{t-1}) + noise, in rad and V."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2, 2, 150), 4)
    y = np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.8 * y[t - 1] + np.tanh(u[t - 1])
    return IOData(u, y + 0.01 * rng.standard_normal(600), 0.1, "voltage", "angle", "V", "rad")


@pytest.fixture(scope="module")
def fit(data):
    model = sysid.structures.hammerstein_wiener(nb=1, nf=1, nk=1, input="polynomial", output="unit_gain")
    return sysid.fit(model, data.split()[0], starts=1)


@pytest.fixture(scope="module")
def evaluation(data, fit):
    estimation, validation = data.split()
    runs = [np.ravel(fit.simulate(part)) for part in (estimation, validation)]
    one = OneStep(*runs, 99.0, 99.0)
    return SimpleNamespace(
        estimation=estimation,
        validation=validation,
        estimation_output=runs[0],
        validation_output=runs[1],
        validation_fit=98.0,
        unseen=True,
        one_step=one,
        band=None,
    )


def values():
    return (
        JointValue("end_low", -0.5, -0.51, -0.49, "rad"),
        JointValue("end_high", 0.9, None, None, "rad", False, "not reached"),
        JointValue("backlash", 0.006, 0.004, 0.008, "rad"),
        JointValue("breakaway_up", 1.0, 0.8, 1.2, "V"),
    )


@pytest.fixture(scope="module")
def figures(data, fit, evaluation):
    info = information(fit, evaluation.estimation)
    e = evaluation.validation.y[:, 0] - evaluation.validation_output
    return {
        name: plotly(figure)
        for name, figure in {
            "record": record_figure(data),
            "parts": parts_figure(evaluation.estimation, evaluation.validation),
            "lines": lines_figure(data.t, {"error": data.y[:, 0]}, "error", "rad"),
            "stack": stack_figure(
                data.t, [Signal(display_quantity("angle", "rad"), data.y[:, 0], "output")], data.t > 59.0
            ),
            "free_run": joined_figure(evaluation),
            "runs": runs_figure(data, {"a": data.y, "b": 2 * data.y[:, 0]}),
            "residual_tests": residuals_figure(residual_tests(e, evaluation.validation.u[:, 0])),
            "static_maps": maps_figure(curves(info)),
            "poles_zeros": roots_figure(poles(info), [0.3 + 0.2j, 0.3 - 0.2j], {"truth": np.array([0.8])}, 0.1),
            "bode": bode_figure(responses.frequency(info), "rad", "V"),
            "step": step_figure(responses.step(info), "rad", "V", "angle"),
            "values": values_figure(values()),
            "joint": parts_of_joint(shown.joint_fit().parts),
        }.items()
    }


def axes(figure, letter):
    return {name: axis for name, axis in figure["layout"].items() if name.startswith(f"{letter}axis")}


def trace(figure, name, axis="y"):
    (found,) = [t for t in figure["data"] if t["name"].startswith(name) and t["yaxis"] == axis]
    return found


def numbers(values):
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def test_every_figure_is_one_of_plotly_and_of_json(figures):
    for name, figure in figures.items():
        assert set(figure) <= {"data", "layout", "frames"}, name
        graph_objects.Figure(figure)  # ValueError names an attribute that plotly does not know
        json.dumps(figure, allow_nan=False)
        assert figure["layout"]["height"] > 150, name


def test_axes_name_their_units_in_degrees(figures):
    for name, figure in figures.items():
        labels = [axis["title"]["text"] for letter in "xy" for axis in axes(figure, letter).values()]
        category = name in ("values", "joint")
        assert all(labels) or category, name
        for label in filter(None, labels):
            pure = name == "static_maps" and "signal" in label
            assert pure or re.search(r"\[[^\]]+\]$", label), f"{name}: {label} has no unit"
            assert "[rad]" not in label, f"{name}: {label}"


def test_lines_are_the_data_in_display_units(figures, data, evaluation):
    drawn = trace(figures["record"], "angle", "y2")
    np.testing.assert_allclose(numbers(drawn["y"]), data.y[:, 0] * DEG)
    np.testing.assert_allclose(numbers(drawn["x"]), data.t)
    assert drawn["hovertemplate"].endswith("deg")
    assert trace(figures["record"], "voltage", "y")["line"]["shape"] == "hv"  # an input is held between samples
    run = numbers(trace(figures["free_run"], "free run", "y")["y"])
    both = np.concatenate([evaluation.estimation_output, [np.nan], evaluation.validation_output]) * DEG
    np.testing.assert_allclose(run, both)  # a gap stands between the parts
    error = numbers(trace(figures["free_run"], "free run", "y2")["y"])
    measured = numbers(trace(figures["free_run"], "measured", "y")["y"])
    np.testing.assert_allclose(error, measured - run)


def test_marked_samples_stand_on_their_line(figures, data):
    line, dots = figures["stack"]["data"]
    np.testing.assert_allclose(numbers(line["y"]), data.y[:, 0] * DEG)
    assert (dots["mode"], dots["name"]) == ("markers", "filled")
    np.testing.assert_allclose(numbers(dots["y"]), data.y[data.t > 59.0, 0] * DEG)


def test_panels_share_one_time_axis_and_the_legend_hides_a_model_in_all(figures):
    figure = figures["runs"]
    assert {t["xaxis"] for t in figure["data"]} == {"x"}
    assert list(axes(figure, "x")) == ["xaxis"]
    of_a = [t for t in figure["data"] if t["name"] == "a"]
    assert [t["yaxis"] for t in of_a] == ["y", "y2"]  # output and error
    assert {t["legendgroup"] for t in of_a} == {"a"}
    assert [t["showlegend"] for t in of_a] == [True, False]
    domains = [axis["domain"] for axis in axes(figure, "y").values()]
    assert all(low > high for (low, _), (_, high) in pairwise(domains))  # none overlap


def test_residuals_have_their_own_lags_in_each_panel_and_the_legend_names_the_bound(figures):
    figure = figures["residual_tests"]
    layout, bars = figure["layout"], figure["data"]
    alone, with_input = ([t for t in bars if t["yaxis"] == axis] for axis in ("y", "y2"))
    assert ({t["xaxis"] for t in alone}, {t["xaxis"] for t in with_input}) == ({"x"}, {"x2"})
    assert (layout["xaxis"]["anchor"], layout["xaxis2"]["anchor"]) == ("y", "y2")
    last = max(max(t["x"]) for t in alone if t["x"])
    assert layout["xaxis"]["range"] == [0.0, last + 0.5]
    assert min(min(t["x"]) for t in with_input if t["x"]) == -last
    upper, lower = (shape for shape in layout["shapes"] if shape["type"] == "rect")
    assert (upper["name"], upper["showlegend"], lower["showlegend"]) == ("99 % bound for one lag", True, False)


@pytest.mark.parametrize("name", ["static_maps", "free_run", "residual_tests"])
def test_the_legend_stands_over_the_titles_of_the_first_row(figures, name):
    """On a phone it is as wide as the figure, and a title of 12 px stands over the upper edge."""
    layout = figures[name]["layout"]
    titles = [a for a in layout["annotations"] if a["text"].startswith("<b>") and a["y"] == 1.0]
    height = layout["height"] - layout["margin"]["t"] - layout["margin"]["b"]
    assert titles
    assert (layout["legend"]["y"] - 1.0) * height >= 18.0
    assert layout["margin"]["t"] >= 18.0 + 40.0  # two lines of a legend


def test_several_outputs_and_experiments_stand_apart():
    rng = np.random.default_rng(1)
    parts = [IOData(rng.normal(size=(n, 2)), rng.normal(size=(n, 3)), 0.5) for n in (40, 60)]
    both = IOData.merge(*parts)
    figure = plotly(runs_figure(both, {"model": both.y + 1.0}))
    assert len(axes(figure, "y")) == 3 + 3 + 2
    assert [a["title"]["text"] for a in axes(figure, "y").values()] == ["y1", "y2", "y3"] * 2 + ["u1", "u2"]
    line = trace(figure, "model", "y3")
    y = numbers(line["y"])
    assert np.flatnonzero(np.isnan(y)).tolist() == [40]  # a gap, not a line from one experiment to the next
    np.testing.assert_allclose(np.delete(y, 40), both.y[:, 2] + 1.0)
    (border,) = figure["layout"]["shapes"]
    assert 39 * 0.5 < border["x0"] < 40 * 0.5


def test_a_long_record_is_thinned_to_its_exact_extremes_and_says_so():
    n = 1_000_000
    rng = np.random.default_rng(2)
    u, y = rng.normal(size=n), rng.normal(size=n)
    y[[123_456, 765_432]] = 50.0, -60.0  # one sample each
    long = IOData(u, y, 1e-3)
    figure = plotly(record_figure(long))
    for line in figure["data"]:
        assert len(line["x"]) <= style.POINTS
        assert "thinned: 4,000 of 1,000,000 samples" in line["hovertemplate"]
    drawn = dict(zip(figure["data"][1]["x"], figure["data"][1]["y"], strict=True))
    assert drawn[123_456 * 1e-3] == 50.0
    assert drawn[765_432 * 1e-3] == -60.0
    edges = np.linspace(0, n, style.POINTS // 2 + 1).astype(int)
    kept = set(drawn.values())
    for a, b in zip(edges[:-1:97], edges[1::97], strict=True):  # each bin, not the whole record alone
        assert {y[a:b].min(), y[a:b].max()} <= kept
    assert len(element(plotly(runs_figure(long, {"model": y})), "long")) < 1e6


def test_a_thinned_line_keeps_gaps_and_the_extremes_beside_them():
    y = np.sin(np.arange(100_000) / 500)
    y[40_000:60_000] = np.nan
    y[39_999], y[60_000] = 5.0, -7.0
    x, thin = style.thin(np.arange(len(y)), y)
    assert np.nanmin(thin) == -7.0
    assert np.nanmax(thin) == 5.0
    assert np.isnan(thin[(x >= 40_000) & (x < 60_000)]).all()
    assert np.isfinite(thin[(x < 40_000) | (x >= 60_000)]).all()


def growing(data, last):
    """A run that follows the data at first and ends at `last` times their size."""
    y = data.y[:, 0].copy()
    y[data.N // 2 :] += np.geomspace(1e-3, last, data.N - data.N // 2)
    return y


@pytest.mark.parametrize("last", [1.0, 30.0, 1e31, -1e31])
def test_a_picture_shows_the_whole_of_a_run(data, last):
    """The measured output and every sample of the model lie between the limits of the axis."""
    run = np.sign(last) * growing(replace(data, y=np.sign(last) * data.y), abs(last))
    drawn = [
        *free_run(Run(data, run, -1e30), Run(data, run, -1e30))[:2],
        *free_runs([Run(data, run, -1e30)]),
    ]
    for ax in drawn:
        low, high = ax.get_ylim()
        assert low < min(run.min(), data.y.min()) * DEG
        assert high > max(run.max(), data.y.max()) * DEG
        seen = ax.transData.transform(np.column_stack([data.t, data.y[:, 0] * DEG]))[:, 1]
        assert np.ptp(seen) > 0.25 * ax.bbox.height  # the data are not flattened
        texts = [t.get_text() for t in ax.get_yticklabels()]
        assert len(set(filter(None, texts))) >= 3


def test_a_zoomable_run_that_stays_near_has_plotlys_own_limits(figures):
    for name in ("free_run", "runs", "record", "parts"):
        for axis in axes(figures[name], "y").values():
            assert "range" not in axis, name
        assert "updatemenus" not in figures[name]["layout"]


def test_a_zoomable_run_that_diverges_says_so_and_can_be_seen_whole(data):
    run = growing(data, 1e31)
    figure = plotly(runs_figure(data, {"model": run, "good": data.y}))
    said = figure["layout"]["meta"]["said"]
    assert re.search(r"The model leaves the data \S+ s after the start and reaches 5.7e32 deg", said)
    assert "good" not in said
    np.testing.assert_allclose(numbers(trace(figure, "model", "y")["y"]), run * DEG)  # all of it is there
    low, high = figure["layout"]["yaxis"]["range"]
    assert low < data.y.min() * DEG < data.y.max() * DEG < high < 10 * np.ptp(data.y) * DEG
    near, whole = figure["layout"]["updatemenus"][0]["buttons"]
    assert near["args"][0]["yaxis.range"] == [low, high]
    assert whole["args"][0] == {"yaxis.autorange": True, "yaxis2.autorange": True}


@pytest.mark.filterwarnings("error")
def test_a_run_that_overflows_leaves_a_gap_and_a_sentence(data):
    run = growing(data, 1e308)
    run[-3:] = np.inf, np.nan, -np.inf
    away = departure(data.y[:, 0], run)
    assert away.lost == data.N - 3
    assert departure(data.y[:, 0], data.y[:, 0]) is None
    figure = plotly(runs_figure(data, {"model": run}))
    assert f"From {(data.N - 3) * 0.1:.4g} s on it is no finite number." in figure["layout"]["meta"]["said"]
    assert trace(figure, "model", "y")["y"][-3:] == [None] * 3
    json.dumps(figure, allow_nan=False)
    style.png(free_runs([Run(data, run, -np.inf)]))


def test_roots_tell_their_meaning(figures):
    (pole,) = [t for t in figures["poles_zeros"]["data"] if t["name"] == "pole" and t["mode"] == "markers"]
    z = pole["x"][0]
    (text,) = pole["hovertext"]
    assert f"time constant {-0.1 / np.log(z):.4g}"[:18] in text
    assert re.search(r"natural frequency \S+ rad/s ± \S+ \(std\)", text)
    assert "damping ratio 1.00" in text  # a real pole does not swing
    (zeros,) = [t for t in figures["poles_zeros"]["data"] if t["name"] == "zero" and t["mode"] == "markers"]
    s = np.log(0.3 + 0.2j) / 0.1
    for swing in zeros["hovertext"]:
        assert f"natural frequency {abs(s):.2f} rad/s" in swing
        assert f"damping ratio {-s.real / abs(s):.3f}" in swing
    assert "standard deviation of z" in text
    low, high = figures["poles_zeros"]["layout"]["xaxis"]["range"]
    assert low < -1 < 1 < high
    far = plotly(roots_figure([3.0 + 0j], Ts=0.1))["layout"]["xaxis"]["range"]
    assert far[1] > 3.0  # no root is outside


def test_bands_hold_their_curves(figures):
    for name, axis in (("bode", "y"), ("bode", "y2"), ("step", "y")):
        area, line = (trace(figures[name], what, axis) for what in ("95 % band", "tangent"))
        low, high = np.nanmin(numbers(area["y"])), np.nanmax(numbers(area["y"]))
        y = numbers(line["y"])
        assert low <= y.min() <= y.max() <= high
        assert area["fill"] == "toself"


def test_values_have_intervals_in_degrees_and_open_points_say_why(figures):
    points = [t for t in figures["values"]["data"] if "lower end stop" in t["y"]]
    (low,) = points
    assert low["x"][0] == pytest.approx(-0.5 * DEG)
    assert low["error_x"]["array"][0] == pytest.approx(0.01 * DEG)
    (open_,) = [t for t in figures["values"]["data"] if t["name"] == "not determined"]
    assert open_["marker"]["symbol"] == "circle-open"
    assert "not reached" in open_["hovertext"][0]
    assert (open_["y"], open_["marker"]["color"]) == (["upper end stop (?)"], style.SECOND)
    backlash = [t["xaxis"] for t in figures["values"]["data"] if "backlash" in t["y"]]
    assert backlash != [low["xaxis"]]  # a hundredth of the travel needs its own axis


def test_a_number_alone_that_is_not_determined_stands_on_a_wide_axis():
    (panel,) = values_figure([JointValue("backlash", 0.006, None, None, "rad", False, "not crossed")]).panels
    assert panel.x.limits == (0.0, pytest.approx(2 * np.degrees(0.006)))


def test_values_without_determination_name_each_reason_and_each_record_once():
    why = "no {} starts from rest: record rising pulses (qpal design --for breakaway FILE)"
    found = [
        JointValue("moving_friction_up", 1.0, 0.8, 1.2, "V", why=f"break-away is not determined: {why.format('up')}"),
        JointValue("breakaway_down", -1.0, None, None, "V", False, why.format("down")),
        JointValue("end_high", 0.9, None, None, "rad", False, "not reached"),
        JointValue("backlash", 0.9, None, None, "rad", False, f"{why.format('slow')}: record longer"),
    ]
    words = undetermined_in_words(SimpleNamespace(values=found, joint_fit=None))
    assert words == (
        "Not determined. Break-away voltage up: no up starts from rest. Break-away voltage down: no down starts "
        "from rest. Upper end stop: not reached. Backlash: no slow starts from rest. What to do: record rising pulses "
        "(qpal design --for breakaway FILE); record longer."
    )


def test_no_value_is_minus_nothing():
    cells = value_cells(JointValue("end_low", -1e-9, -0.01, 0.01, "s"))
    assert cells == ("0.000", "−0.010 to 0.010", "s")


def test_a_band_that_makes_the_error_a_line_gets_a_panel_of_the_error_alone(evaluation):
    run = evaluation.validation_output
    for wide, panels in ((100.0, 4), (1e-3, 3)):
        band = SimpleNamespace(y=run, lower=run - wide, upper=run + wide, level=0.95)
        given = SimpleNamespace(**{**vars(evaluation), "band": band, "one_step": None})
        assert len(joined_figure(given).panels) == panels


def test_an_element_gives_back_its_figure_and_no_text_ends_the_script(data):
    name = "</script><b>&"
    figure = plotly(lines_figure(data.t, {name: data.y[:, 0], "b": data.y[:, 0]}, "error"))
    figure["data"][0]["y"][3] = None
    html = element(figure, "one")
    assert html.count("</script>") == 1
    assert '<div class="zoom" id="zoom-one"' in html
    back = json.loads(html.partition('data-for="zoom-one">')[2].removesuffix("</script>"))
    assert unescape(back["data"][0]["name"]) == name  # as plotly shows it
    values = np.frombuffer(base64.b64decode(back["data"][0]["y"]["bdata"]), "<f8")
    np.testing.assert_array_equal(values, numbers(figure["data"][0]["y"]))
    assert back["layout"] == figure["layout"]

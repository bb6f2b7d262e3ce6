"""Figures show the values of the record: constants that were removed before a fit are added again."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import sysid
from sysid import plots
from sysid.data.preprocess import detrend
from sysid.data.record import IOData
from sysid.drawing.axes import draw
from sysid.drawing.plotly import plotly
from sysid.plots.free_runs import runs_figure
from sysid.plots.records import parts_figure
from sysid.plots.responses import step_figure
from sysid.report import figures, inspection
from sysid.report.verdict import exit_sentence
from sysid.uncertainty.curves import NORMALISED, OWN, Curve
from sysid.uncertainty.intervals import Band

DEG = 180.0 / np.pi
T = 0.05 * np.arange(400)
WAVE = np.sin(2 * np.pi * T / 5.0)  # up at 1.25 s, down at 3.75 s, four times


@pytest.fixture
def removed():
    """A record about 0.5 rad and 3 V, without them, and a run that follows it."""
    data = IOData(3.0 + 0.2 * WAVE, 0.5 + 0.3 * WAVE, 0.05, "voltage", "angle", "V", "rad")
    data = detrend(data)
    assert abs(data.y).max() < 0.31
    return data, data.y[:, 0] + 0.01


def lies(line, low, high):
    """Whether a drawn line goes from low to high [deg]."""
    y = np.asarray(line.get_ydata() if hasattr(line, "get_ydata") else line["y"], dtype=float)
    return (y.min(), y.max()) == pytest.approx((low, high), abs=0.2)


MEASURED, MODEL = (0.2 * DEG, 0.8 * DEG), (0.21 * DEG, 0.81 * DEG)


def test_output_and_runs_stand_where_the_record_has_them(removed):
    data, run = removed
    one = plots.Run(data, run, 96.0)
    for axes in (
        plots.free_run(one, one)[0],
        plots.free_run(one, one)[1],
        plots.free_runs([one])[0],
        plots.fitted(data, run, [96.0])[0],
        plots.close_ups(data, run)[0],
    ):
        assert lies(axes.lines[0], *MEASURED) or axes.lines[0].get_ydata().max() == pytest.approx(0.8 * DEG, abs=0.2)
        assert (axes.lines[1].get_ydata() - axes.lines[0].get_ydata()).mean() == pytest.approx(0.01 * DEG)
    u, y = plots.parts(data, data)
    assert lies(y.lines[1], *MEASURED)
    assert u.lines[1].get_ydata().mean() == pytest.approx(3.0, abs=1e-6)
    error = plots.free_run(one, one)[2].lines[0].get_ydata()
    np.testing.assert_allclose(error, -0.01 * DEG)


def test_the_same_to_zoom(removed):
    data, run = removed
    e = SimpleNamespace(
        estimation=data,
        validation=data,
        estimation_output=run,
        validation_output=run,
        validation_fit=96.0,
        unseen=True,
        one_step=None,
        band=None,
    )
    measured, model, error, u = plotly(figures.joined_figure(e))["data"]
    measured, model, u = ({"y": [v for v in trace["y"] if v is not None]} for trace in (measured, model, u))
    assert lies(measured, *MEASURED)
    assert lies(model, *MODEL)
    assert np.mean(u["y"]) == pytest.approx(3.0, abs=1e-3)
    assert np.nanmean(np.array(error["y"], dtype=float)) == pytest.approx(-0.01 * DEG, rel=1e-3)
    assert lies(plotly(runs_figure(data, {"model": run}))["data"][0], *MEASURED)
    assert lies(plotly(parts_figure(data, data))["data"][2], *MEASURED)


def test_the_caption_says_what_was_added_only_where_something_was(removed):
    data, _ = removed
    raw = replace(data, u_offset=np.zeros(1), y_offset=np.zeros(1))
    assert "are added again" in figures.data_caption(SimpleNamespace(estimation=data, validation=data, unseen=True))
    assert "added" not in figures.data_caption(SimpleNamespace(estimation=raw, validation=raw, unseen=True))


def test_a_run_that_leaves_the_data_is_told_as_it_is_drawn(removed):
    data, _ = removed
    away = SimpleNamespace(validation=data, validation_output=np.linspace(0.0, 4.5, data.N))
    assert "reaches 286 deg" in exit_sentence(away).replace("2.9e2", "286") or "reaches 290 deg" in exit_sentence(away)


@pytest.mark.parametrize(
    ("role", "scale", "x0", "y0"),
    [
        ("input", OWN, 3.0, 0.0),
        ("input", NORMALISED, 3.0, 3.0),
        ("output", NORMALISED, 0.5, 0.5),
        ("middle", OWN, 0, 0),
    ],
)
def test_maps_stand_over_the_signals_of_the_record(role, scale, x0, y0, removed, monkeypatch):
    data, _ = removed
    x = np.linspace(-1.0, 1.0, 5)
    curve = Curve(role, Band(x, 2 * x, 0 * x, 2 * x - 1, 2 * x + 1, 0.95, ""), scale, "", "")
    monkeypatch.setattr(figures, "bands", lambda e: SimpleNamespace(maps=(curve,)))
    (shown,) = figures.recorded_maps(SimpleNamespace(estimation=data))
    np.testing.assert_allclose(shown.band.x, x + x0)
    np.testing.assert_allclose([shown.band.value, shown.band.lower], [2 * x + y0, 2 * x - 1 + y0])


def test_a_peak_that_the_record_cuts_off_is_no_peak():
    y = np.cos(2 * np.pi * T / 5.0)  # begins on an upper peak; the next is at 5 s
    up, down = plots.close_ups(IOData(0 * y, y, 0.05), y)
    for axes, at in ((up, 5.0), (down, 2.5)):
        shown = axes.lines[0].get_xdata()
        assert shown[0] < at - 0.5
        assert shown[-1] > at + 0.5
    rest = np.where(T < 1.0, -1.0, -0.7 * np.cos(2 * np.pi * T / 5.0))  # rests lowest first; the whole dip is less deep
    down = plots.close_ups(IOData(0 * y, rest, 0.05), rest)[1].lines[0].get_xdata()
    assert down[0] < 5.0 < down[-1]
    falling = np.linspace(1.0, 0.0, 400)  # has no other: the end is shown
    up, down = plots.close_ups(IOData(0 * y, falling, 0.05), falling)
    assert up.lines[0].get_ydata().max() == 1.0
    assert down.lines[0].get_ydata().min() == 0.0


def test_a_band_that_is_nowhere_to_be_seen_is_not_in_the_legend():
    x = np.arange(6.0)
    unknown = np.r_[0.0, np.full(5, np.nan)]  # the sample before the delay is known, and without width
    note = "the record does not excite it"
    axes = plots.step(Band(x, x, unknown, unknown, unknown, 0.95, note))
    assert axes.get_legend() is None
    assert [t.get_text() for t in axes.texts] == ["the record does not excite all of this curve: no band there"]
    names = [t.get("name") for t in plotly(step_figure(Band(x, x, unknown, unknown, unknown, 0.95, "")))["data"]]
    assert names == ["tangent"]
    wide = plots.step(Band(x, x, 0 * x + 1, x - 1, x + 1, 0.95, ""))
    assert [t.get_text() for t in wide.get_legend().get_texts()] == ["tangent", "95 % band"]


@pytest.mark.parametrize("ms", [np.full(500, 10.0), np.r_[np.full(500, 10.0), 30.0], np.r_[9.0, np.full(500, 10.0)]])
def test_the_bar_of_the_sampling_time_stands_on_its_line(ms):
    (axes,) = draw(inspection.steps_figure(SimpleNamespace(sampling=SimpleNamespace(steps=1e-3 * ms), Ts=0.01)))
    tallest = max(axes.patches, key=lambda bar: bar.get_height())
    assert tallest.get_height() == 500
    assert tallest.get_x() + 0.5 * tallest.get_width() == pytest.approx(10.0)
    assert axes.lines[0].get_xdata()[0] == pytest.approx(10.0)
    assert sum(bar.get_height() for bar in axes.patches) == len(ms)


def test_a_fit_of_a_record_about_a_level_is_drawn_about_it(removed):
    data, _ = removed
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 40), 10)
    y = np.zeros(400)
    for t in range(1, 400):
        y[t] = 0.8 * y[t - 1] + 0.2 * u[t - 1]
    data = detrend(IOData(3 + u, 0.5 + y, 0.05, "voltage", "angle", "V", "rad"))
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1), data)
    axes = plots.free_runs([plots.Run(data, np.ravel(fit.simulate(data)), fit.fit_percent(data))])[0]
    np.testing.assert_allclose(axes.lines[1].get_ydata()[20:], (0.5 + y[20:]) * DEG, atol=0.5)

"""Figures of results: axes with units, a sentence, what they draw, and figures that pyplot finds."""

import pickle
import sys
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import shown

import sysid
from sysid import plots
from sysid.base import style
from sysid.data.preprocess import detrend

pytestmark = pytest.mark.pixels

mpl.use("Agg")
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def data():
    return shown.data()


@pytest.fixture
def fit():
    return shown.fit()


@pytest.fixture
def linear():
    return shown.linear()


@pytest.fixture
def network():
    return shown.network()


@pytest.fixture
def joint():
    return shown.joint_fit()


@pytest.mark.parametrize("what", ["output", "residuals", "poles", "bode", "step", "maps"])
def test_every_figure_of_a_fit_has_axes_with_units_and_a_sentence(fit, what):
    figure = fit.plot(what=what)
    assert figure.get_supxlabel().startswith("What to see: ")
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert all(labels)
    assert not any("[rad]" in text for text in labels)


def test_the_figure_of_the_output_shows_run_and_error(data, fit):
    over, under = fit.plot(data).axes
    np.testing.assert_allclose(over.lines[0].get_ydata(), np.degrees(data.y[:, 0]))
    np.testing.assert_allclose(over.lines[1].get_ydata(), np.degrees(fit.simulate(data)))
    np.testing.assert_allclose(under.lines[0].get_ydata(), np.degrees(data.y[:, 0] - fit.simulate(data)))
    assert f"{fit.fit_percent(data):.2f} %" in over.get_legend().get_texts()[1].get_text()
    assert over.patches[0].get_extents() is not None
    low, high = under.get_ylim()
    assert low < np.degrees(data.y[:, 0] - fit.simulate(data)).min()
    assert high < np.degrees(np.ptp(data.y))


def test_the_output_is_drawn_at_the_level_of_the_record(data, fit, network):
    moved = replace(data, y=data.y + 0.5)
    for made in (fit, network):
        there, away = made.plot(moved).axes[0], made.plot(detrend(moved)).axes[0]
        for a, b in zip(there.lines[:2], away.lines[:2], strict=True):
            np.testing.assert_allclose(a.get_ydata(), b.get_ydata(), atol=1e-6)
        np.testing.assert_allclose(away.lines[0].get_ydata(), np.degrees(moved.y[:, 0]))


def test_an_operating_point_is_chosen_where_the_tangent_is_flat(data):
    model = sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1, input="saturation", fixed={"input": (-1.0, 0.0)})
    held = sysid.fit(model, data, search="lm", starts=1)
    with pytest.raises(sysid.InputError, match=r"fit\.plot\(data, \"bode\", at=u\)"):
        held.plot(data, "bode", at=0.5)
    lines = [held.plot(data, "bode", at=u).axes[0].lines[0].get_ydata() for u in (-0.2, -0.1)]
    assert all(np.isfinite(line).all() for line in lines)
    assert not np.allclose(*lines)  # the output map has another slope there
    steps = [held.plot(data, "step", at=u).axes[0].lines[0].get_ydata()[-1] for u in (-0.5, 0.5)]
    assert abs(steps[1]) < 1e-9 < abs(steps[0])
    with pytest.raises(sysid.InputError, match="at= chooses the operating point of bode and step"):
        held.plot(data, "output", at=0.5)


def test_a_run_that_leaves_the_frame_does_not_flatten_its_error(data):
    over, under = plots.fitted(data, 1e9 * np.arange(500.0), [-1e9])
    heights = over.transData.transform([(0.0, np.degrees(v)) for v in (data.y.min(), data.y.max())])[:, 1]
    assert np.ptp(heights) > 0.15 * over.bbox.height  # the data are seen, and so is the whole run
    assert over.get_ylim()[1] >= np.degrees(1e9 * 499)
    assert under.get_ylim()[0] <= -np.degrees(1e9 * 498)


def test_several_channels_have_a_panel_each_and_experiments_a_border():
    rng = np.random.default_rng(0)
    wide = sysid.IOData(rng.normal(size=(50, 2)), rng.normal(size=(50, 3)), 0.1)
    panels = sysid.IOData.merge(wide, wide).plot().axes
    assert [ax.get_title("left") for ax in panels] == [
        "(a) input 1",
        "(b) input 2",
        "(c) output 1",
        "(d) output 2",
        "(e) output 3",
    ]
    for k, ax in enumerate(panels):
        expected = np.tile((np.column_stack([wide.u, wide.y]))[:, k], 2)
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), expected)
        assert ax.lines[1].get_xdata()[0] == pytest.approx(4.95)


def test_figures_of_the_parts_of_a_joint_and_of_a_comparison(joint, data, fit, linear, network):
    (axes,) = joint.plot().axes
    assert [text.get_text() for text in axes.get_yticklabels()] == [
        "extra friction at rest, up: shown by the record",
        "friction by load: shown to be absent",
        "backlash: not determined",
    ]
    values, largest = np.array([0.5, 0.0, 0.01]), np.array([0.3, 0.2, 0.0]) + 1.96 * np.array([0.3, 0.3, 0.015])
    points = {line.get_ydata()[0]: line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata())}
    np.testing.assert_allclose([points[k].get_xdata()[0] for k in range(3)], 100.0 * values / largest)
    assert [points[k].get_color() for k in range(3)] == [style.MODEL, style.INPUT, style.SECOND]
    with pytest.raises(sysid.InputError, match="choose one of shown, open, absent"):
        plots.usual([("loss", (0.2, 0.3), (0.1, 0.1), "sure")])
    with pytest.raises(sysid.InputError, match="no part to draw"):
        replace(joint, parts=()).plot()
    (bars,) = sysid.compare(data, fit, linear, network).plot().axes
    assert len(bars.patches) == 3


def test_a_figure_that_a_model_has_not_is_refused_with_what_it_has(fit, linear, network):
    with pytest.raises(sysid.InputError, match="unknown figure 'nyquist'; choose one of output, residuals"):
        fit.plot(what="nyquist")
    with pytest.raises(sysid.InputError, match="no static map"):
        linear.plot(what="maps")
    with pytest.raises(sysid.InputError, match=r"choose one of output, residuals$"):
        network.plot(what="poles")
    assert len(network.plot().axes) == 2
    for call in (network.refine, network.modes, network.noise_model):
        with pytest.raises(sysid.InputError, match="nonlinear ARX"):
            call()


@pytest.fixture
def pyplot():
    import matplotlib.pyplot as plt

    plt.close("all")
    yield plt
    plt.close("all")


def test_pyplot_finds_a_figure_that_was_asked_for_and_none_of_a_report(pyplot, data, fit, tmp_path):
    first, second = data.plot(), fit.plot()
    assert pyplot.get_fignums() == [1, 2]
    assert pyplot.gcf() is second
    assert pyplot.figure(1) is first
    pyplot.close("all")
    style.png(plots.record(data))
    fit.report(tmp_path / "fit.html")
    assert pyplot.get_fignums() == []
    plots.record(data)
    assert pyplot.get_fignums() == []


def test_without_pyplot_and_in_a_notebook_a_figure_is_its_own_picture(pyplot, data, monkeypatch):
    before = dict(mpl.rcParams)
    monkeypatch.setattr(pyplot, "get_backend", lambda: "module://matplotlib_inline.backend_inline")
    shown = data.plot()
    assert shown._repr_png_().startswith(PNG)
    assert pyplot.get_fignums() == []
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot")
    alone = data.plot()
    assert alone._repr_png_().startswith(PNG)
    assert dict(mpl.rcParams) == before
    assert "Sheet" in repr(type(pickle.loads(pickle.dumps(alone))))


def test_a_window_stays_one_after_its_picture(pyplot, data):
    figure = data.plot()
    manager = figure.canvas.manager
    assert figure._repr_png_().startswith(PNG)
    assert figure.canvas.manager is manager
    assert pyplot.get_fignums() == [1]

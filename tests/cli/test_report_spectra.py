"""The record over the frequency in the report of a linear model, and labels that do not run into each other."""

import numpy as np
import pytest
from often import by_day
from scipy.signal import lfilter

from sysid.base import style
from sysid.channels.mapping import Range
from sysid.report import figures, identify
from sysid.report.bands import bands
from sysid.structures import BoxJenkins, Hammerstein, OutputError, ProcessModel
from sysid.workflow.identification import identify_file
from sysid.workflow.saved import Exports
from sysid.workflow.setting import Setting


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A resonant plant in slow noise, with long names."""
    rng, N = np.random.default_rng(4), 3000
    u = np.repeat(rng.normal(size=N // 3), 3)
    y = lfilter([0.0, 0.4, 0.2], [1.0, -1.5, 0.7], u) + lfilter([1.0, 0.5], [1.0, -0.9], 0.1 * rng.normal(size=N))
    path = tmp_path_factory.mktemp("log") / "log.csv"
    head = "time [s],voltage of the heater [V],temperature of the reactor jacket [degC]"
    rows = np.column_stack([0.1 * np.arange(N), u, y])
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    return str(path)


SETTINGS = {
    "bj": Setting(BoxJenkins(2, 2, 1, 1, 1)),
    "output_error": Setting(OutputError(2, 2, 1)),
    "process": Setting(ProcessModel("P2DZU")),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_the_model_is_inside_the_band_of_the_record_and_its_noise_in_that_of_the_errors(log, name):
    result = identify_file(log, SETTINGS[name])
    e = result.evaluation
    known = bands(e)
    size, w = known.spectrum.magnitude, known.spectrum.magnitude.x
    model = np.interp(np.log(w), np.log(known.frequency.magnitude.x), known.frequency.magnitude.value)
    least = 0.7 if name == "process" else 0.8  # the plant is one of samples, which no process is exactly
    assert np.mean((size.lower <= model) & (model <= size.upper)) > least
    noise, power = known.noise
    assert np.mean((noise.lower <= power) & (power <= noise.upper)) > 0.8
    section = next(s for s in identify.page(result, Exports()).sections if s.title == "Spectra")
    assert [picture.name for picture in section.pictures] == ["spectrum", "noise"]
    assert ("its own C and D" in figures.noise_caption(e)) == (name == "bj")
    drawn = figures.TABLE["spectrum"].draw(e)
    assert [ax.get_ylabel().split()[0] for ax in drawn] == ["magnitude", "phase", "coherence"]
    assert drawn[0].get_legend_handles_labels()[1] == ["estimate", "95 % band", "model"]
    assert "²/Hz]" in figures.TABLE["noise"].draw(e)[0].get_ylabel()


@pytest.mark.parametrize("name", by_day(["bj", "process"], "bj"))
def test_labels_of_neighbouring_panels_do_not_touch(log, name):
    e = identify_file(log, SETTINGS[name]).evaluation
    for key, figure in figures.TABLE.items():
        if not figure.applies(e):
            continue
        axes = figure.draw(e)
        sheet = axes[0].figure
        style.png(axes)
        sheet.set_dpi(style.DPI)
        spans = [
            (ax.get_subplotspec().colspan.start, *ax.yaxis.label.get_window_extent().intervaly)
            for ax in axes
            if ax.get_ylabel()
        ]
        below = [(a, b) for k, a in enumerate(spans) for b in spans[k + 1 :] if a[0] == b[0]]
        assert all(upper[1] > lower[2] for upper, lower in below), key
        assert all(low >= -0.01 and high <= sheet.bbox.height for _, low, high in spans), key


def test_a_nonlinear_model_and_a_short_record_have_none(log):
    result = identify_file(log, Setting(Hammerstein(2, 2, 1, "saturation"), starts=1))
    assert not any(s.title == "Spectra" for s in identify.page(result, Exports()).sections)
    short = identify_file(log, SETTINGS["output_error"], range=Range(start=0.0, stop=6.0))
    assert not any(s.title == "Spectra" for s in identify.page(short, Exports()).sections)

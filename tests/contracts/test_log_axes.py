"""Numbers on logarithmic axes are plain text: figures draw no formulas, since a channel may be called a$b$."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import sysid
import twin
from sysid import plots
from sysid.base import style
from sysid.base.style import log_axis, power
from sysid.drawing.axes import draw
from sysid.drawing.departure import frame, spread_axis
from sysid.report import inspection
from sysid.uncertainty import responses
from twin.report import calibrate, compare_figures

pytestmark = pytest.mark.pixels


def bode():
    from sysid.systems import system

    plant = system("textbook")
    data = plant.record(300, 0.05, np.random.default_rng(1))
    fit = sysid.fit(plant.chain, data, search="lm", starts=1)
    return plots.bode(responses.frequency(sysid.information(fit, data)))


def cost():
    found = SimpleNamespace(first=5.0, history=[{"loss": 0.4}, {"loss": 2e-6}])
    run = SimpleNamespace(y=np.ones(10), held_out=False)
    return draw(calibrate.cost_figure(SimpleNamespace(found=found, runs=[run])))


def spectra():
    f = np.geomspace(0.05, 40, 50)
    band = (1 / f, 0.5 / f, 2 / f)
    one = SimpleNamespace(frequency=f, magnitude=band, phase=band, known=f > 0)
    return draw(compare_figures.spectra_figure(SimpleNamespace(spectra=(one, one), kind="twin", label="twin")))


def steps():
    clock = SimpleNamespace(steps=np.r_[np.full(30000, 0.01), 0.03])
    return draw(inspection.steps_figure(SimpleNamespace(sampling=clock, Ts=0.01)))


@style.styled
def departed():
    (axes,) = style.panels(None)
    spread_axis(axes, frame(np.linspace(-1, 1, 9)), 10.0 ** np.arange(9))
    return [axes]


def numbers(axes):
    """Text at the ticks of a drawn figure."""
    style.png(axes)
    found = [t.get_text() for ax in axes for a in (ax.xaxis, ax.yaxis) for t in a.get_ticklabels(which="both")]
    return [text for text in found if text]


@pytest.mark.parametrize("draw", [bode, cost, spectra, steps, departed])
def test_no_number_at_a_tick_is_a_formula(draw):
    axes = draw()
    assert any({ax.get_xscale(), ax.get_yscale()} - {"linear"} for ax in axes)
    found = numbers(axes)
    assert len(found) > 4
    assert not [text for text in found if re.search(r"[$\\{}^]", text)]


def test_every_logarithmic_axis_is_made_in_one_place():
    """Any other one has matplotlib's formulas for numbers."""
    logarithmic = re.compile(r"""semilog[xy]\(|loglog\(|scale\(\s*["'](sym)?log|[xy]scale\s*=\s*["'](sym)?log""")
    for package in (sysid, twin):
        for path in Path(package.__path__[0]).rglob("*.py"):
            if path != Path(style.__file__):
                assert not logarithmic.search(path.read_text(encoding="utf-8")), path


def test_a_name_with_dollars_is_shown_as_it_is():
    (axes,) = plots.usual([("a$b$", (0.3, 0.3), (0.5, 0.1), "shown")])
    style.png(axes)
    names = axes.get_yticklabels()
    assert names[0].get_text() == "a$b$: shown by the record"
    assert not names[0].get_parse_math()


@style.styled
def one(low, high, **kwargs):
    (axes,) = style.panels(None)
    axes.plot([low, high], [low, high])
    log_axis(axes, "x", **kwargs)
    return axes


def test_an_axis_has_the_numbers_that_matplotlib_would_write():
    x = [t.get_text() for t in one(0.02, 5000.0).get_xticklabels()]
    assert {"0.1", "1", "10", "100", "1000"} <= set(x)
    narrow = one(2.0, 4.0)
    style.png(narrow)
    assert "3" in [t.get_text() for t in narrow.get_xticklabels(which="minor")]


def test_numbers_at_ticks():
    values = (0, 0.001, 0.1, 20, 1e4, 1e5, 2.5e7, -1e-4, 1e-30)
    assert [power(v) for v in values] == ["0", "0.001", "0.1", "20", "10000", "1e5", "2.5e7", "−1e−4", "1e−30"]

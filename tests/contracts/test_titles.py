"""Titles and legends share the line above their axes only where both fit into it."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid import plots
from sysid.base import style
from sysid.base.looks import for_a_person, house_look
from sysid.diagnosis.residuals import residual_tests
from sysid.drawing.axes import draw
from twin.report import calibrate, compare_figures, leg

pytestmark = pytest.mark.pixels


@style.styled
def sheet(title, names, columns=1):
    rows = style.panels(None, 1, columns, height=2.6)
    for k, name in enumerate(names):
        rows[0].plot([0, 1], [k, 1], label=name)
    style.legend(rows[0])
    rows[0].set(title=title)
    return rows


def box(artist):
    """Edges of a drawn part of a figure."""
    b = artist.get_window_extent()
    return b.x0, b.x1, b.y0, b.y1


def apart(axes):
    """Whether the drawn title and legend cover nothing of each other, and the legend stays over its own axes."""
    with house_look():
        axes.figure.draw_without_rendering()
    a, b = box(axes._left_title), box(axes.get_legend())
    over = a[0] < b[1] + 4 and b[0] < a[1] + 4 and a[2] < b[3] and b[2] < a[3]
    return not over and b[0] > axes.bbox.x0 - 2 and b[2] > axes.bbox.y1 - 2


def spectra():
    f = np.geomspace(0.05, 40, 50)
    band = (1e-3 / f, 0.5e-3 / f, 2e-3 / f)
    one = SimpleNamespace(frequency=f, magnitude=band, phase=band, known=f > 0)
    return draw(
        compare_figures.spectra_figure(SimpleNamespace(spectra=(one, one), kind="log", label="a-second-log.parquet"))
    )


def residuals():
    rng = np.random.default_rng(3)
    u = rng.standard_normal(400)
    return plots.residual_tests(residual_tests(np.roll(u, 2) + rng.standard_normal(400), u))


def legs():
    a, y = np.zeros((2, 4, 3)), np.linspace(0, 0.4, 8).reshape(2, 4, 1) * np.array([0, 1, -1])
    return leg.draw({"log": leg.Poses(y, a), "calibrated twin": leg.Poses(y + 0.01, a)})


def overlay():
    y = np.sin(np.arange(99))
    run = SimpleNamespace(half=None, u=y, y=y, before=y, after=y, Ts=0.1, name="a-long-name-of-a-file-of-the-rig.csv")
    return draw(calibrate.overlay_figure(run))


CASES = {
    "spectra": spectra,
    "residuals": residuals,
    "leg": legs,
    "overlay": overlay,
    "long": lambda: sheet("a title that is long, of which no word is to be lost at all", ["measured", "free run", "x"]),
    "wide": lambda: sheet("title", [f"a name of many letters {k}" for k in range(7)]),
    "narrow": lambda: sheet("(a) a title", ["measured output", "free run of the model", "noise"], 2),
}


@pytest.mark.parametrize("case", CASES)
def test_no_legend_covers_a_title(case):
    axes = CASES[case]()
    style.png(axes)
    drawn = [ax for ax in axes if ax.get_legend() is not None]
    assert drawn
    assert all(apart(ax) for ax in drawn)


def test_a_figure_at_a_prompt_is_the_same():
    with for_a_person():
        axes = CASES["long"]()
        axes[0].figure._repr_png_()
    assert apart(axes[0])


def test_what_fits_into_a_line_stays_in_it():
    axes = sheet("title", ["a", "b"])
    style.png(axes)
    title, legend = box(axes[0]._left_title), box(axes[0].get_legend())
    assert title[2] < legend[3]
    assert [t.get_text() for t in axes[0].get_legend().get_texts()] == ["a", "b"]


def test_fewer_columns_keep_names_and_colours():
    axes = CASES["wide"]()
    style.png(axes)
    legend = axes[0].get_legend()
    assert [t.get_text() for t in legend.get_texts()] == [f"a name of many letters {k}" for k in range(7)]
    assert [line.get_color() for line in legend.get_lines()] == [line.get_color() for line in axes[0].lines]

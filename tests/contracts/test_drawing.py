"""A figure is described once and drawn twice: both renderers show the same places, for every kind of item."""

import numpy as np
import pytest
from plotly import graph_objects

from sysid.base import style
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Band, Figure, Line, Panel, Points, Ranges, Rule, Span, Stems
from sysid.drawing.plotly import plotly

X = np.array([0.0, 1.0, 2.0])
NAMES = Axis(names=("a", "b"))


def drawn(*items, y=Axis(), x=Axis()):  # noqa: B008 - they are frozen
    """The axes of matplotlib and the checked figure of plotly."""
    figure = Figure([Panel(items, y, x)])
    return draw(figure)[0], graph_objects.Figure(plotly(figure))


def test_lines_and_points_have_the_same_numbers():
    ax, zoom = drawn(Line(X, X**2, "line"), Points(X, -X, "points"))
    for artist, trace in zip(ax.lines, zoom.data, strict=True):
        np.testing.assert_array_equal(artist.get_xdata(), trace.x)
        np.testing.assert_array_equal(artist.get_ydata(), trace.y)


def test_a_range_ends_where_its_numbers_say():
    ax, zoom = drawn(Ranges([1], [3.0], [2.5], [4.0], "range"), y=NAMES)
    (bar,) = (line for line in ax.lines if len(line.get_xdata()) == 2)
    assert list(bar.get_xdata()) == [2.5, 4.0]
    (trace,) = zoom.data
    assert (trace.x[0] - trace.error_x.arrayminus[0], trace.x[0] + trace.error_x.array[0]) == (2.5, 4.0)
    assert trace.y == ("b",)


def test_a_rule_and_a_span_stand_at_the_same_places():
    ax, zoom = drawn(Line(X, X, "line"), Rule(1.25), Rule(0.5, upright=False), Span(0.25, 0.75))
    assert [ax.lines[1].get_xdata()[0], ax.lines[2].get_ydata()[0]] == [1.25, 0.5]
    (area,) = ax.patches
    assert (area.get_x(), area.get_x() + area.get_width()) == (0.25, 0.75)
    upright, level, span = zoom.layout.shapes
    assert (upright.x0, upright.x1, level.y0, level.y1) == (1.25, 1.25, 0.5, 0.5)
    assert (span.x0, span.x1) == (0.25, 0.75)


def test_stems_that_stand_out_are_told_apart_in_both():
    y = np.array([1.0, -0.1, -0.6])
    ax, zoom = drawn(Stems(X, y, 0.5, np.abs(y) > 0.5))
    assert [list(line.get_ydata()) for line in ax.lines] == [[-0.1], [1.0, -0.6]]
    assert [list(trace.y) for trace in zoom.data] == [[-0.1], [1.0, -0.6]]


def test_the_last_value_of_a_stepped_band_stands_as_long_as_the_one_before():
    _, zoom = drawn(Band(X, X, X + 1.0, "band", steps=True))
    assert max(zoom.data[0].x) == 3.0


@pytest.mark.parametrize("colour", [style.MODEL, style.INK, style.BOUND, *style.COLOURS])
def test_an_area_may_have_any_colour_of_the_house(colour):
    _, zoom = drawn(Band(X, X, X + 1.0, "band", colour), Span(0.0, 1.0, colour=colour))
    assert zoom.data[0].fill == "toself"
    assert zoom.layout.shapes[0].fillcolor == zoom.data[0].fillcolor

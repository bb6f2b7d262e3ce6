"""Physical values of an actuated joint with their intervals, one panel for values of one unit and size."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.style import styled
from sysid.base.units import shown
from sysid.joint.values import JointValue
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.report.joint_words import groups, short
from sysid.report.sections import told_once
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 3  # more beside each other leave no room for the names


@styled
def draw(e: Evaluation) -> Sequence[Axes]:
    """A point and a bar each; an open point is not determined."""
    from matplotlib.ticker import MaxNLocator

    by_axis = groups(e.values)
    most = max(len(values) for values in by_axis.values())
    rows = -(-len(by_axis) // COLUMNS)
    columns = -(-len(by_axis) // rows)
    grid = style.panels(None, rows, columns, height=0.4 + rows * (0.9 + 0.28 * most))
    for spare in grid[len(by_axis) :]:
        spare.remove()
    found = grid[: len(by_axis)]
    for ax, ((unit, _), values) in zip(found, by_axis.items(), strict=True):
        for place, v in enumerate(values):
            _point(ax, place, v)
        ax.set_yticks(range(len(values)), [short(v) for v in values])
        ax.set(ylim=(len(values) - 0.5, -0.5), xlabel=f"value [{unit}]" if unit else "value")
        ax.margins(x=0.15)
        ax.xaxis.set_major_locator(MaxNLocator(5))
    _legend(found[0], any(not _sure(v) for v in told_once(e.values)))
    return found


def _sure(v: JointValue) -> bool:
    return v.low is not None and v.high is not None


def _legend(ax: Axes, some_open: bool) -> None:
    """Below all panels: what a filled and an open point are."""
    (known,) = ax.plot([], [], "o-", color=style.MODEL, linewidth=2.0, markersize=4, label="value, 95 % interval")
    handles = [known]
    if some_open:
        handles += ax.plot([], [], "o", color=style.MODEL, markerfacecolor="none", markersize=4, label="not determined")
    ax.figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


def _point(ax: Axes, place: int, v: JointValue) -> None:
    factor = shown(v.name, v.unit).factor
    if v.low is not None and v.high is not None:
        ax.plot(np.array([v.low, v.high]) * factor, [place, place], color=style.MODEL, linewidth=2.0)
    face = style.MODEL if _sure(v) else "none"
    ax.plot(v.value * factor, place, "o", color=style.MODEL, markerfacecolor=face, markersize=4)


def caption(e: Evaluation) -> str:
    """What the points are, and whether some are open."""
    some = any(v.low is None for v in told_once(e.values))
    doubt = " An open point is a number of the model that the record does not determine." if some else ""
    return f"Physical values (points) with their 95 % intervals (bars); voltages are those at mid stroke.{doubt}"


def applies(e: Evaluation) -> bool:
    """If the model has physical values."""
    return bool(e.values)


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    return zoom.values(e.values)


FIGURE = ReportFigure("Model", draw, caption, applies, zoom=zoomed)

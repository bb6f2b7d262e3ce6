"""The static maps over the range of the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.plots import static_maps
from sysid.report.figures._figure import ReportFigure
from sysid.uncertainty.curves import OWN, Curve
from sysid.uncertainty.intervals import Band
from sysid.workflow.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORDS = {  # by role: title, signal before the map, signal after it
    "input": ("input map", "input u", "into the linear block"),
    "output": ("output map", "out of the linear block", "output y"),
    "middle": ("middle map", "into the map", "out of the map"),
    "driver": ("driver map", "input u", "motor voltage"),
    "map": ("linkage", "actuator's position [strokes]", "output y"),
    "sensor": ("sensor map", "behind play and linkage", "output y"),
}
SEES_INPUT, GIVES_OUTPUT = ("input", "driver"), ("output", "map", "sensor")


def draw(e: Evaluation) -> Sequence[Axes]:
    """A panel for each map, in the order of the signal."""
    return static_maps([_curve(e, role) for role in e.maps], words=WORDS)


def _curve(e: Evaluation, role: str) -> Curve:
    u, y = e.estimation.u_unit, e.estimation.y_unit
    before = u if role in SEES_INPUT else y if role == "sensor" else ""
    after = y if role in GIVES_OUTPUT else u if role == "driver" else ""
    return Curve(role, Band.bare(e.maps[role].x, e.maps[role].y), OWN, before, after)


def caption(e: Evaluation) -> str:
    """The names and the scale of the maps."""
    only = (
        "Only the shape has a meaning: a gain can move between a map and the linear block without changing the model."
    )
    if not e.linear:
        only = "The linkage's map runs from 0 at one end of the actuator's stroke to 1 at the other."
    names = " and ".join(role.replace("map", "linkage") for role in e.maps)
    return f"Static {names} map over the range of the estimation data. {only}"


def applies(e: Evaluation) -> bool:
    """If the structure has maps."""
    return bool(e.maps)


FIGURE = ReportFigure("Model", draw, caption, applies)

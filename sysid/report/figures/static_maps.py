"""The static maps over the range of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sysid.plots import static_maps
from sysid.report import zoom
from sysid.report.bands import GIVES_OUTPUT, SEES_INPUT, bands
from sysid.report.figures._figure import ReportFigure
from sysid.uncertainty.curves import NORMALISED, Curve
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Words = tuple[str, str, str]  # title, signal before the map, signal after it
WORDS: dict[str, Words] = {  # by role
    "input": ("input map", "input u", "into the linear block"),
    "output": ("output map", "out of the linear block", "output y"),
    "middle": ("middle map", "into the map", "out of the map"),
    "driver": ("driver map", "input u", "motor voltage"),
    "map": ("linkage", "actuator's position [strokes]", "output y"),
    "sensor": ("sensor map", "behind play and linkage", "output y"),
}
SCALED: dict[str, Words] = {  # the same where the record gives the scale of the signal between the blocks
    "input": ("input map", "input u", "out of the map, on the scale of u"),
    "output": ("output map", "into the map, on the scale of y", "output y"),
    "middle": ("middle map", "into the map, in standard deviations", "out, in standard deviations"),
}


def draw(e: Evaluation) -> Sequence[Axes]:
    """A panel for each map, in the order of the signal."""
    curves = recorded(e)
    return static_maps(curves, words=_words(curves))


def recorded(e: Evaluation) -> list[Curve]:
    """The maps over signals as recorded: constants that were removed from input and output are added again.

    A normalised map has the outer signal's scale on both sides.
    """
    u, y = (0.0 if len(each) > 1 else float(each[0]) for each in (e.estimation.u_offset, e.estimation.y_offset))
    found = list[Curve]()
    for curve in bands(e).maps:
        x0, y0 = u * (curve.role in SEES_INPUT), y * (curve.role in GIVES_OUTPUT)
        if curve.scale == NORMALISED:
            x0 = y0 = x0 or y0
        b = curve.band
        moved = replace(b, x=b.x + x0, value=b.value + y0, lower=b.lower + y0, upper=b.upper + y0)
        found.append(replace(curve, band=moved))
    return found


def _words(curves: Sequence[Curve]) -> dict[str, Words]:
    scaled = {c.role for c in curves if c.scale == NORMALISED}
    return {c.role: (SCALED if c.role in scaled else WORDS).get(c.role, WORDS["middle"]) for c in curves}


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    curves = recorded(e)
    return zoom.static_maps(curves, _words(curves))


def caption(e: Evaluation) -> str:
    """The names and the scale of the maps."""
    only = (
        "Only the shape has a meaning: a gain can move between a map and the linear block without changing the model."
    )
    if not e.linear:
        only = "The linkage's map runs from 0 at one end of the actuator's stroke to 1 at the other."
    elif any(curve.scale == NORMALISED for curve in bands(e).maps):
        only += (
            " A signal between the blocks is therefore shown with the mean and deviation of the signal outside; on the "
            "dashed diagonal a map would change nothing."
        )
    names = " and ".join(role.replace("map", "linkage") for role in e.maps)
    return f"Static {names} map over the range of the estimation data. {only}"


def applies(e: Evaluation) -> bool:
    """If the structure has maps."""
    return bool(e.maps)


FIGURE = ReportFigure("Model", draw, caption, applies, zoom=zoomed)

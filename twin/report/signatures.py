"""The section of signatures: one small picture for each imperfection, with its measured and true size."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.quantities import display_quantity, number
from sysid.base.style import styled
from sysid.report.page import Grid, Picture, Section
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.imperfections import Imperfection, Mark, Signature

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL = (3.3, 2.6)  # [inch]; three fit next to each other on a page
OFF = "#b8c1ca"
# Position of a mark's text: its anchor on the arrow's frame, the offset in points, and the alignment.
PLACES = {
    "right": ((1.0, 0.5), (5, 0), "left", "center"),
    "outside": ((1.0, 0.5), (5, 0), "left", "center"),
    "left": ((0.0, 0.5), (-5, 0), "right", "center"),
    "above": ((0.5, 1.0), (0, 5), "center", "bottom"),
    "below": ((0.5, 0.0), (0, -5), "center", "top"),
    "corner": ((1.0, 1.0), (14, 2), "left", "center"),
    "top left": ((0.0, 1.0), (-6, 2), "right", "bottom"),
}
ROOM = 0.4  # of the axes' width, for the text of a mark that stands outside of the data


def section(signatures: Sequence[Signature]) -> Section:
    """All signatures and their sizes."""
    return Section("Signatures", [_INTRODUCTION], [sizes(signatures)], pictures(signatures), small_pictures=True)


_INTRODUCTION = (
    "Each picture shows the effect of one imperfection on a joint: dark with it, light grey without it. Other "
    "effects are on only if the experiment needs them. Arrows span the size in the data and are labelled with the "
    "parameter. The table compares sizes measured in the picture's data with the parameters, with the imperfection "
    "and without it."
)


def pictures(signatures: Sequence[Signature]) -> list[Picture]:
    """One picture per signature."""
    return [
        Picture(f"signature-{signature.key}", style.png(draw(signature)), f"{signature.sentence} ({signature.joint})")
        for signature in signatures
    ]


def sizes(signatures: Sequence[Signature]) -> Grid:
    """Measured beside true."""
    rows = []
    for signature in signatures:
        for size in signature.sizes:
            unit = display_quantity("", size.unit)
            values = (_value(v * unit.factor, size.true * unit.factor) for v in (size.measured, size.true, size.off))
            rows.append((signature.name, size.name, signature.joint, *values, unit.unit, ", ".join(size.rows)))
    headings = ("switch", "what is measured", "joint", "measured", "true", "switched off", "unit", "true from")
    return Grid(headings, rows, text_columns=3, last_text=True)


def markdown(signatures: Sequence[Signature]) -> str:
    """The table of sizes, and the text and the pictures of each imperfection, KEY.png beside it."""
    grid = sizes(signatures).only("switch", "what is measured", "joint", "measured", "true", "unit")
    chapters = [_chapter(imperfection, signatures) for imperfection in IMPERFECTIONS.values()]
    return "\n".join([grid.markdown(), *chapters])


def _chapter(i: type[Imperfection], signatures: Sequence[Signature]) -> str:
    """The heading, text and pictures of an imperfection."""
    first, *rest = [f"![{s.sentence}]({s.key}.png)" for s in signatures if s.name == i.name]
    texts = [i.about, f"Model: {i.model}", f"Parameters: {i.parameters}", first, i.remark, *rest]
    lines = [text if text.startswith("![") else textwrap.fill(text, 120, break_on_hyphens=False) for text in texts]
    return "\n\n".join(text for text in (f"## {i.title}: `{i.name}`", *lines) if text) + "\n"


def _value(value: float, true: float) -> str:
    """Four digits, or 0 for a value that is negligible relative to the true size (rounding, transients)."""
    return "0" if abs(value) < 5e-3 * abs(true) else number(float(f"{value:.4g}"))


@styled
def draw(signature: Signature) -> Figure:
    """One signature, by itself."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=PANEL, layout="constrained")
    panel(figure.subplots(), signature)
    return figure


def panel(axes: Axes, signature: Signature) -> None:
    """Lines without the imperfection below those with it; marks have their own colour."""
    x, y = (display_quantity(axis.name, axis.unit) for axis in (signature.x, signature.y))
    for line in sorted(signature.lines, key=lambda line: line.on):
        colour = style.INK if line.on else OFF
        data = np.asarray(line.x) * x.factor, np.asarray(line.y) * y.factor
        if line.dots:
            axes.plot(*data, ".", color=colour, markersize=3.5)
        else:
            width = 1.1 if line.on else 2.2  # the light line stays visible under the dark one
            style.line(axes, *data, line.steps, color=colour, linewidth=width)
    for mark in signature.marks:
        _mark(axes, mark, x.factor, y.factor)
    axes.set(title=signature.title, xlabel=x.label, ylabel=y.label)
    places = {mark.place for mark in signature.marks}
    axes.margins(x=0.06, y=0.24 if "above" in places else 0.10)
    if "outside" in places:
        low, high = axes.get_xlim()
        axes.set_xlim(low, high + ROOM * (high - low))


def _mark(axes: Axes, mark: Mark, x: float, y: float) -> None:
    """Draw an arrow with its text; `x` and `y` are the factors of the axes' units."""
    ends = np.array([mark.start, mark.end]) * (x, y)
    arrow = {"arrowstyle": "<|-|>,head_width=0.18,head_length=0.35", "color": style.MODEL, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", ends[1], ends[0], arrowprops={**arrow, "linewidth": 1.1}, zorder=5)
    unit = display_quantity("", mark.unit)
    size = f"{_short(mark.value * unit.factor)} {unit.unit}".rstrip()
    share, offset, horizontal, vertical = PLACES[mark.place]
    anchor = ends.min(axis=0) + share * np.ptp(ends, axis=0)
    text = axes.annotate(mark.text.format(size), anchor, offset, textcoords="offset points", color=style.MODEL)
    text.set(ha=horizontal, va=vertical, fontsize=8.5, zorder=6)
    text.set(bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 0.6})


def _short(value: float) -> str:
    """At most three digits, without trailing zeros."""
    text = number(value, 3)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text

"""The pieces of a report: pictures, tables, listings, and the sections that hold them."""

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base import style
from sysid.base.errors import printable
from sysid.drawing.axes import draw
from sysid.drawing.figure import Figure
from sysid.drawing.plotly import Plotly, plotly
from sysid.report import glossary

PACKED = 64  # numbers; a longer list travels as the bytes of its doubles, which are exact and half as long


@dataclass(frozen=True)
class Picture:
    """A PNG with its file name and caption, and the same as a zoomable figure of plotly where there is one.

    On a screen the page shows the zoomable figure; paper, and a reader without scripts, get the PNG. A `photo` keeps
    its colours in the dark.
    """

    name: str
    png: bytes
    caption: str
    zoom: Plotly | None = None
    photo: bool = False

    @classmethod
    def of(cls, name: str, figure: Figure, caption: str, zooms: bool = True) -> "Picture":
        """A figure drawn twice, or once: a page of which no picture zooms is without 5 MB of script."""
        return cls(name, style.png(draw(figure), few=True), caption, plotly(figure) if zooms else None)

    @property
    def data(self) -> str:
        """The PNG as base64, for embedding in the page."""
        return base64.b64encode(self.png).decode("ascii")

    @property
    def element(self) -> str:
        """The HTML of the zoomable figure; empty without one."""
        return "" if self.zoom is None else element(self.zoom, self.name)

    @property
    def sentence(self) -> str:
        """The caption, with what the zoomable figure says of itself."""
        more_text = (self.zoom or {}).get("layout", {}).get("meta", {}).get("said", "")
        return f"{self.caption} {more_text}".strip()


@dataclass(frozen=True)
class Grid:
    """A table: headings, rows of cells, and the number of leading text columns (the others are numbers)."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    text_columns: int = 1
    quiet_rows: frozenset[int] = frozenset()  # rows shown for reference, in grey
    last_text: bool = False  # the last column is text too
    sortable: bool = False  # by a click on a heading
    note: str = ""  # what is known of all its numbers, below the table of a page

    def is_text(self, j: int) -> bool:
        """Whether column j is aligned as text."""
        return j < self.text_columns or (self.last_text and j == len(self.headings) - 1)

    def terms(self) -> list[str]:
        """The headings, and the names of the rows."""
        return [*self.headings, *(str(row[0]) for row in self.rows if row and not self.sortable)]

    def title(self, row: Sequence[str], j: int) -> str:
        """What a cell of numbers is, for the pointer: its row, its column and what that means; empty for text."""
        if self.is_text(j) or self.sortable:
            return ""
        parts = [str(text) for text in (row[0] if self.text_columns else "", self.headings[j]) if text]
        meaning = glossary.meaning(self.headings[j]) or (glossary.meaning(str(row[0])) if self.text_columns else "")
        units = [k for k, heading in enumerate(self.headings) if heading == "unit"]
        unit = f" [{row[units[0]]}]" if units and row[units[0]] not in ("", "–") else ""
        return f"{', '.join(parts)}{unit}{': ' if meaning else ''}{meaning}"

    def markdown(self) -> str:
        """The table in Markdown, numbers to the right; its last line ends too."""
        marks = [":--" if self.is_text(j) else "--:" for j in range(len(self.headings))]
        return "".join("| " + " | ".join(row) + " |\n" for row in (self.headings, marks, *self.rows))

    def only(self, *headings: str) -> "Grid":
        """The columns with these headings; they must start with the text columns."""
        keep = [list(self.headings).index(heading) for heading in headings]
        return replace(
            self,
            headings=headings,
            rows=[[row[j] for j in keep] for row in self.rows],
            text_columns=sum(j < self.text_columns for j in keep),
            last_text=self.is_text(keep[-1]),
        )


@dataclass(frozen=True)
class Listing:
    """Preformatted text, shown on request."""

    caption: str
    text: str


@dataclass(frozen=True)
class Section:
    """A heading with its content in the order: paragraphs, plots, tables, pictures, hidden tables and listings.

    `plots` are elements of `element` beside the pictures.
    """

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Grid] = ()
    pictures: Sequence[Picture] = ()
    details: Sequence[Grid] = ()
    listings: Sequence[Listing] = ()
    small_pictures: bool = False
    plots: Sequence[str] = ()

    @property
    def anchor(self) -> str:
        """The link target of this section."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower()).strip("-")


def element(figure: Plotly, name: str) -> str:
    """The HTML of a figure: a box of its height, named `name`, that `DRAW` fills; nothing is drawn without scripts.

    Raises ValueError for a number that JSON has not.
    """
    height = int(figure["layout"].get("height", 400))
    box = f'<div class="zoom" id="zoom-{name}" style="height:{height}px"></div>'
    return box + figure_script(figure, f"zoom-{name}")


def figure_script(figure: Plotly, box: str) -> str:
    """The HTML of what `DRAW` draws into the element whose id is `box`; ValueError for a number that JSON has not."""
    text = json.dumps(packed(figure), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    safe = text.replace("<", "\\u003c").replace("&", "\\u0026")  # no text of a figure ends the script or opens a tag
    return f'<script type="application/json" data-for="{html.escape(box)}">{safe}</script>'


def packed(value: Any) -> Any:
    """A figure as JSON values, long lists of numbers as base64."""
    if isinstance(value, dict):
        return {printable(str(key)): packed(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        if len(value) > PACKED and all(entry is None or isinstance(entry, int | float) for entry in value):
            doubles = np.array([np.nan if entry is None else entry for entry in value], dtype="<f8")
            return {"dtype": "f8", "bdata": base64.b64encode(doubles.tobytes()).decode("ascii")}
        return [packed(entry) for entry in value]
    if isinstance(value, np.generic):
        return packed(value.item())
    if isinstance(value, str):
        return printable(value)
    return None if isinstance(value, float) and not np.isfinite(value) else value

"""A report: sections of sentences, tables and pictures, as HTML without network access.

`Page.html` is one file. `write` puts plotly beside the page, once for a folder, and the page shows its pictures without
zoom where it is taken from there alone.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import style
from sysid.base.errors import printable, readable
from sysid.base.files import json_text, json_value, write_text
from sysid.drawing.axes import draw
from sysid.drawing.figure import Figure
from sysid.drawing.plotly import Plotly, plotly
from sysid.report import glossary

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

    from sysid.report.answer import Answer

PACKED = 64  # numbers; a longer list travels as the bytes of its doubles, which are exact and half as long
DRAW = resources.files("sysid.report").joinpath("zoom.js").read_text(encoding="utf-8")
SCRIPT = "plotly.min.js"
SORT = resources.files("sysid.report").joinpath("sort.js").read_text(encoding="utf-8")
# A page needs no address but its own: what it shows is inside it, and its scripts are those of this module.
POLICY = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


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


@dataclass(frozen=True)
class Page:
    """A whole report: title, subtitle, verdict, sections, and the versions that made it.

    Below an `answer`, which a page shows first, the verdict and all sections are folded.
    """

    title: str
    subtitle: str
    verdict: Sequence[str]
    sections: Sequence[Section] = ()
    made_with: dict[str, str] = field(default_factory=dict)
    wide: bool = False  # for tables of many columns
    answer: "Answer | None" = None

    def html(self, beside: bool = False) -> str:
        """The page as one document, with plotly in it if a figure needs it; or with plotly `beside` it, as `SCRIPT`."""
        return _render(self.title, self.draws, self.sorts, beside, page=self)

    @property
    def draws(self) -> bool:
        """Whether a figure needs plotly."""
        plots = [*(section.plots for section in self.sections), self.answer and self.answer.plot]
        return any(picture.zoom is not None for picture in self.pictures()) or any(plots)

    @property
    def words(self) -> dict[str, str]:
        """The terms of the tables that the glossary explains, in order of their first use."""
        tables = [table for section in self.sections for table in (*section.tables, *section.details)]
        tables = [*(self.answer.tables if self.answer else ()), *tables]
        cells = [cell for table in tables for cell in table.terms()]
        return {glossary.without_unit(cell): meaning for cell in cells if (meaning := glossary.meaning(cell))}

    @property
    def sorts(self) -> bool:
        """Whether a table can be sorted."""
        return any(table.sortable for section in self.sections for table in (*section.tables, *section.details))

    def pictures(self) -> Iterator[Picture]:
        """All pictures, in order."""
        if self.answer is not None and self.answer.picture is not None:
            yield self.answer.picture
        for section in self.sections:
            yield from section.pictures


def rebuilt(title: str, body: str, draws: bool) -> str:
    """A page around a `body` of HTML that was written before and has been checked; `draws` for one with figures."""
    return _render(title, draws, body=body, page=None)


def _render(title: str, draws: bool, sorts: bool = False, beside: bool = False, **parts: Any) -> str:
    """The document, whose policy names the hash of each script in it and lets the script `beside` it run."""
    source = SCRIPT if draws and beside else ""
    texts = {"draw": DRAW if draws else "", "sort": SORT if sorts else ""}
    texts["plotly"] = script() if draws and not beside else ""
    hashes = [_hash(text) for text in texts.values() if text]
    sources = " ".join([*hashes, *(["'self'", "file:"] if source else [])]) or "'none'"
    return _template().render(title=title, policy=f"{POLICY}; script-src {sources}", source=source, **texts, **parts)


@cache
def _hash(script_text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(script_text.encode()).digest()).decode()}'"


@cache
def _template() -> "Template":
    import jinja2
    import markupsafe

    source = resources.files("sysid.report").joinpath("template.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=_shown)
    environment.filters["commands"] = _commands
    environment.filters["whole"] = lambda text: markupsafe.escape(printable(text))
    environment.globals["meaning"] = glossary.meaning
    return environment.from_string(source)


def _shown(value: object) -> object:
    """What the template writes, for each of its places: text from files acts on no reader; markup stays as it is."""
    return readable(value) if type(value) is str else value


# A command ends before a mark at the end of a word, a bracket, and a word that goes on with the sentence.
_COMMAND = re.compile(r"(qpal [a-z]+(?: (?!(?:and|or|then|to|with|shows|says)\b)[^\s()]*[^\s().,;:])*)")
_MINUS = re.compile(r"(?<![\w.,-])-(?=\d)")


def _commands(sentence: object) -> "Markup":
    """A sentence with its commands set as code that no line break cuts inside a word, and with true minus signs."""
    from markupsafe import Markup, escape

    if isinstance(sentence, Markup):
        return sentence
    text = Markup()
    for k, part in enumerate(_COMMAND.split(readable(str(sentence)))):
        words = Markup(" ").join(Markup("<span>{}</span>").format(word) for word in part.split())
        text += Markup("<code>{}</code>").format(words) if k % 2 else escape(_MINUS.sub("−", part))
    return text


def write(folder: Path, page: Page, summary: dict[str, Any]) -> None:
    """Write report.html, its script, summary.json and figures/*.png to `folder`, which the caller moves into place."""
    figures = folder / "figures"
    figures.mkdir()
    for picture in page.pictures():
        (figures / f"{picture.name}.png").write_bytes(picture.png)
    if page.draws:
        write_text(folder / SCRIPT, script())
    for name, text in (("report.html", page.html(beside=True)), ("summary.json", to_json(summary))):
        write_text(folder / name, text)


def to_json(summary: dict[str, Any]) -> str:
    """A summary as strict JSON; numbers that are not finite become null."""
    return json_text(json_value(summary), indent=2) + "\n"


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


def script() -> str:
    """The text of plotly.js, about 5 MB, once for a folder of pages, or in a page that stands alone."""
    from plotly import offline

    return printable(str(offline.get_plotlyjs()))  # as files are written: the page's policy has its hash


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

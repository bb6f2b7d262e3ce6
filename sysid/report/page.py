"""A report: sections of sentences, tables and pictures, as HTML without network access.

`Page.html` is one file. `write` puts plotly beside the page, once for a folder, and the page shows its pictures without
zoom where it is taken from there alone.
"""

import base64
import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.base.errors import printable, readable
from sysid.base.files import json_text, json_value, write_text
from sysid.report import glossary
from sysid.report.answer import Answer
from sysid.report.pieces import Grid, Listing, Picture, Section, element, figure_script, packed

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

__all__ = ["Grid", "Listing", "Page", "Picture", "Section", "element", "figure_script", "packed", "rebuilt", "write"]

DRAW = resources.files("sysid.report").joinpath("zoom.js").read_text(encoding="utf-8")
SCRIPT = "plotly.min.js"
SORT = resources.files("sysid.report").joinpath("sort.js").read_text(encoding="utf-8")
# A page needs no address but its own: what it shows is inside it, and its scripts are those of this module.
POLICY = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


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
    answer: Answer | None = None

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


# A command ends before a mark at the end of a word, a bracket, and a word that goes on with the sentence. A quoted
# word, as of a column "Pump (%)", may hold all of these; an apostrophe in it stands as '"'"'.
_QUOTED = r"(?:'[^']*'(?:\"'\"'[^']*')*|\"[^\"]*\")(?![\w'])"
_COMMAND = re.compile(rf"(qpal [a-z]+(?: (?:{_QUOTED}|(?!(?:and|or|then|to|with|shows|says)\b)[^\s()]*[^\s().,;:]))*)")
_WORD = re.compile(rf"{_QUOTED}|\S+")
_MINUS = re.compile(r"(?<![\w.,-])-(?=\d)")


def _commands(sentence: object) -> "Markup":
    """A sentence with its commands set as code that no line break cuts inside a word, and with true minus signs."""
    from markupsafe import Markup, escape

    if isinstance(sentence, Markup):
        return sentence
    text = Markup()
    for k, part in enumerate(_COMMAND.split(readable(str(sentence)))):
        words = Markup(" ").join(
            Markup("<span{}>{}</span>").format(Markup(' class="quoted"') if " " in word else "", word)
            for word in _WORD.findall(part)
        )
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


def script() -> str:
    """The text of plotly.js, about 5 MB, once for a folder of pages, or in a page that stands alone."""
    from plotly import offline

    return printable(str(offline.get_plotlyjs()))  # as files are written: the page's policy has its hash

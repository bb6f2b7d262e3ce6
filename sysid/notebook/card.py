"""A result on one screen: the same title, facts, tables and sentences as text for a terminal and as HTML."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from sysid.base.errors import readable

LINES = 40  # of text on one screen, what is folded away not counted
WIDTH = 110
_CELL = "padding:1px 10px 1px 0;text-align:{};border:none;background:none"


def _text(text: str) -> str:
    return escape(readable(text))


@dataclass(frozen=True)
class Table:
    """Headings and rows of text; the first `text_columns` columns stand left, the others right as numbers do.

    `most` rows are shown at most, and then their number.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    text_columns: int = 1
    most: int = 12

    @property
    def shown(self) -> Sequence[Sequence[str]]:
        """The rows that have a place."""
        return self.rows[: self.most]

    @property
    def more(self) -> str:
        """How many rows have none."""
        left = len(self.rows) - len(self.shown)
        return f"and {left} more" if left > 0 else ""

    def text(self) -> list[str]:
        """Lines for a terminal, columns under each other."""
        grid = [tuple(self.headings), *(tuple(row) for row in self.shown)]
        widths = [max(len(row[j]) for row in grid) for j in range(len(self.headings))]
        lines = []
        for row in grid:
            sized = enumerate(zip(row, widths, strict=True))
            cells = [c.ljust(w) if j < self.text_columns else c.rjust(w) for j, (c, w) in sized]
            lines.append(("  " + "  ".join(cells)).rstrip()[:WIDTH])
        return [*([self.caption] if self.caption else []), *lines, *([f"  {self.more}"] if self.more else [])]

    def html(self) -> str:
        """The same as an HTML table."""
        head = "".join(self._cell("th", j, text) for j, text in enumerate(self.headings))
        body = "".join(
            "<tr>" + "".join(self._cell("td", j, text) for j, text in enumerate(row)) + "</tr>" for row in self.shown
        )
        caption = f'<div style="margin-top:.5em"><b>{_text(self.caption)}</b></div>' if self.caption else ""
        more = f"<div>{_text(self.more)}</div>" if self.more else ""
        table = f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
        return f'{caption}<table style="border-collapse:collapse;margin:0;font-size:inherit">{table}</table>{more}'

    def _cell(self, tag: str, j: int, text: str) -> str:
        side = "left" if j < self.text_columns else "right"
        return f'<{tag} style="{_CELL.format(side)}">{_text(text)}</{tag}>'


@dataclass(frozen=True)
class Card:
    """A title, sentences to read `first`, facts (name and value), tables, sentences, and tables that a notebook folds
    away behind their caption.

    `call` says in the terminal how what is folded away can be had.
    """

    title: str
    facts: Sequence[tuple[str, str]] = ()
    tables: Sequence[Table] = ()
    sentences: Sequence[str] = ()
    folded: Sequence[Table] = ()
    call: str = ""
    first: Sequence[str] = ()

    def text(self) -> str:
        """At most `LINES` lines."""
        width = max((len(name) for name, _ in self.facts), default=0)
        lines = [self.title, *(part for sentence in self.first for part in _wrapped(sentence))]
        lines += [f"  {name.ljust(width)}  {value}" for name, value in self.facts]
        for table in self.tables:
            lines += table.text()
        lines += [part for sentence in self.sentences for part in _wrapped(sentence)]
        if len(lines) >= LINES:
            lines = [*lines[: LINES - 2], "..."]
        return "\n".join([*lines, *([self.call] if self.call else [])])

    def html(self) -> str:
        """A fragment for a notebook; every text is escaped, and colours are those of the page."""
        facts = "".join(
            f'<tr><td style="{_CELL.format("left")}">{_text(name)}</td>'
            f'<td style="{_CELL.format("left")}">{_text(value)}</td></tr>'
            for name, value in self.facts
        )
        parts = [f"<div><b>{_text(self.title)}</b></div>", *(f"<div>{_text(text)}</div>" for text in self.first)]
        parts += (
            [f'<table style="border-collapse:collapse;margin:0;font-size:inherit"><tbody>{facts}</tbody></table>']
            if facts
            else []
        )
        parts += [table.html() for table in self.tables]
        parts += [f"<div>{_text(sentence)}</div>" for sentence in self.sentences]
        for table in self.folded:
            whole = Table(table.headings, table.rows, "", table.text_columns, len(table.rows))
            parts.append(f"<details><summary>{_text(table.caption)}</summary>{whole.html()}</details>")
        return f'<div style="font-size:90%">{"".join(parts)}</div>'


def _wrapped(sentence: str) -> list[str]:
    """The sentence in lines of `WIDTH`."""
    lines, line = [], ""
    for word in sentence.split():
        if line and len(line) + 1 + len(word) > WIDTH:
            lines.append(line)
            line = ""
        line = f"{line} {word}".strip()
    return [*lines, line]

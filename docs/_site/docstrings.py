"""Docstrings of this project are plain text with `code` in single quotes: here they become reStructuredText."""

import re
import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

CODE = re.compile(r"`([^`]+)`")
MARKS = re.compile(r"([*|\\]|(?<=\w)_(?=\W|$))")  # what reStructuredText would take for its own marks
UNDERLINE = re.compile(r"^\s*[-=~]{3,}\s*$", re.MULTILINE)
SIGNATURE = (
    (re.compile(r"~[\w.]+\.(\w+)"), r"\1"),
    (re.compile(r"Annotated\[(\w+), [^\]]*\]"), r"\1"),
    (re.compile(r"<factory>|<object object at \w+>"), "..."),
)


def restructured(text: str) -> str:
    """One line of a docstring: code as code, everything else as it is written."""
    pieces = CODE.split(text)
    return "".join(MARKS.sub(r"\\\1", piece) if k % 2 == 0 else f"``{piece}``" for k, piece in enumerate(pieces))


def _convert(app, what, name, found, options, lines: list[str]) -> None:
    """In place, as Sphinx asks for it. Single quotes may open on one line and close on the next: whole paragraphs."""
    paragraphs = "\n".join(lines).split("\n\n")
    lines[:] = "\n\n".join(map(_paragraph, paragraphs)).split("\n")


def _paragraph(text: str) -> str:
    """An indented paragraph is an example; one that is no reStructuredText is shown as it is written."""
    marked = restructured(text)
    if text.startswith("    ") or not _parses(marked):
        return "::\n\n" + textwrap.indent(textwrap.dedent(text), "    ")
    return marked


def _parses(text: str) -> bool:
    from docutils.frontend import get_default_settings  # here, so that tests can use this file without docutils
    from docutils.parsers.rst import Parser
    from docutils.utils import SystemMessage, new_document

    if UNDERLINE.search(text):  # a heading, for which there is no place within a description
        return False
    settings = get_default_settings(Parser)
    settings.report_level = settings.halt_level = 2  # what Sphinx would warn of
    settings.warning_stream = False
    try:
        Parser().parse(text, new_document("docstring", settings))
    except SystemMessage:
        return False
    return True


def _signature(app, what, name, found, options, signature: str | None, returned: str | None):
    """Signatures as one writes them: without modules before types, and without the checks of pydantic."""

    def short(text: str | None) -> str | None:
        for pattern, plain in SIGNATURE:
            text = pattern.sub(plain, text) if text else text
        return text

    return short(signature), short(returned)


def _skip(app, what, name, found, skip, options) -> bool | None:
    return True if name == "model_config" else None  # pydantic's


def setup(app: "Sphinx") -> None:
    app.connect("autodoc-process-docstring", _convert)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skip)

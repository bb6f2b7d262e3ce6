"""Docstrings of this project are plain text with `code` in single quotes: here they become reStructuredText."""

import re

from sphinx.application import Sphinx

CODE = re.compile(r"`([^`]+)`")
MARKS = re.compile(r"([*|\\]|(?<=\w)_(?=\W|$))")  # what reStructuredText would take for its own marks


def restructured(text: str) -> str:
    """One line of a docstring: code as code, everything else as it is written."""
    pieces = CODE.split(text)
    return "".join(MARKS.sub(r"\\\1", piece) if k % 2 == 0 else f"``{piece}``" for k, piece in enumerate(pieces))


def _convert(app, what, name, found, options, lines: list[str]) -> None:
    """In place, as Sphinx asks for it. Single quotes may open on one line and close on the next: whole paragraphs."""
    paragraphs = "\n".join(lines).split("\n\n")
    lines[:] = "\n\n".join(map(_paragraph, paragraphs)).split("\n")


def _paragraph(text: str) -> str:
    """An indented paragraph is an example."""
    return f"::\n\n{text}" if text.startswith("    ") else restructured(text)


def setup(app: Sphinx) -> None:
    app.connect("autodoc-process-docstring", _convert)

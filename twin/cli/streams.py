"""Standard streams as they come: closed ones, ones that take few letters, and ones that cannot be written to."""

import codecs
import os
import sys
import unicodedata
from contextlib import suppress
from typing import Any

LETTERS = {
    "−": "-", "–": "-", "—": "-", "×": "x", "·": ".", "•": "*", "°": "deg", "µ": "u", "±": "+/-", "≤": "<=", "≥": ">=",
    "≈": "~", "∞": "inf", "√": "sqrt", "→": "->", "←": "<-", "“": '"', "”": '"', "‘": "'", "’": "'", "…": "...",
}  # fmt: skip
BOX = {"HORIZONTAL": "-", "VERTICAL": "|"}
PLAIN = "qpal-plain"  # the name of `_encoded` among Python's ways to treat what an encoding lacks


def prepare() -> None:
    """Every stream can be written to from here on, with any text.

    A closed one leads nowhere: its number would otherwise go to the next file that opens, and prints into that file.
    Text that the encoding of a stream lacks is replaced by plain letters.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            _replace_closed(number, name)
    codecs.register_error(PLAIN, _encoded)
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError, OSError):  # it is none of Python's own, or cannot be changed
            stream.reconfigure(errors=PLAIN)  # type: ignore[union-attr]


def say(sentence: str) -> None:
    """A line on standard error, if anybody can hear it."""
    try:
        print(sentence, file=sys.stderr, flush=True)
    except (OSError, ValueError):
        drop("stderr")


def flush() -> None:
    """Standard output is out; a reader that went away is no error. Raises OSError if it cannot be written to."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        drop()


def drop(name: str = "stdout") -> None:
    """A stream leads nowhere from here on: what still waits in it must not fail again while Python ends."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, getattr(sys, name).fileno())
        os.close(nowhere)


def plain(text: str) -> str:
    """A text in ASCII: rules of tables, Greek letters and signs by what they look like or are called."""
    return "".join(c if c.isascii() else _letters(c) for c in text)


def _letters(c: str) -> str:
    if c in LETTERS:
        return LETTERS[c]
    kind, *words = unicodedata.name(c, "NONE").split()
    if kind == "BOX":
        return next((sign for word, sign in BOX.items() if words[-1] == word and "AND" not in words), "+")
    if kind == "GREEK" and words[1:2] == ["LETTER"]:
        return words[2].title() if words[0] == "CAPITAL" else words[2].lower()
    parts = unicodedata.decomposition(c)
    simple = "".join(LETTERS.get(d, d) for d in unicodedata.normalize("NFKD", c)).encode("ascii", "ignore").decode()
    if parts.startswith("<super>"):
        return "^" + simple
    return simple or c.encode("ascii", "backslashreplace").decode()


def _encoded(error: UnicodeError) -> tuple[str | bytes, int]:
    """What stands for letters that a stream lacks; a byte of a file name that is no text stays that byte."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    first = error.object[error.start]
    if "\udc80" <= first <= "\udcff":
        return bytes([ord(first) - 0xDC00]), error.start + 1
    return plain(first), error.start + 1


def _replace_closed(number: int, name: str) -> None:
    try:
        os.fstat(number)
    except OSError:
        nowhere = os.open(os.devnull, os.O_RDWR)
        if nowhere != number:
            os.dup2(nowhere, number)
            os.close(nowhere)
    mode: Any = "r" if number == 0 else "w"
    setattr(sys, name, open(os.devnull, mode, encoding="utf-8", errors="replace"))  # noqa: SIM115

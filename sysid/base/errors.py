"""The error that bad input raises: a sentence that says what was found, what was allowed and what to do."""

import re
from collections.abc import Iterable

WORD, TEXT = 500, 2000  # characters; a damaged file may have names of a million
BLANKS = "\n\t\xa0\u202f"


class InputError(ValueError):
    """Bad input; its text is one sentence for the user. The command line prints it and exits with 2."""

    def __init__(self, *said: object) -> None:
        """Names of damaged files are in it: what no terminal takes is written as \\x1b, what is long is cut."""
        super().__init__(*(_readable(s) if isinstance(s, str) else s for s in said))


def printable(text: str) -> str:
    """The text with what steers a terminal written as \\x1b."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in BLANKS else ascii(c)[1:-1] for c in text)


def _readable(text: str) -> str:
    text = printable(text)
    text = re.sub(rf"\S{{{WORD},}}", lambda word: f"{word[0][:200]}...{word[0][-200:]}", text)
    return text if len(text) <= TEXT else f"{text[: TEXT // 2]} ... {text[-TEXT // 2 :]}"


def unknown(what: str, got: str, allowed: Iterable[str]) -> InputError:
    """The error for a name that is not in a table: unknown joint 'knee'; choose one of shoulder, thigh, shank."""
    return InputError(f"unknown {what} {got!r}; choose one of {', '.join(allowed)}")

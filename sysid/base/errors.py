"""The error that bad input raises: a sentence that says what was found, what was allowed and what to do."""

import re
from collections.abc import Iterable
from typing import Any

WORD, TEXT = 500, 2000  # characters; a damaged file may have names of a million
BLANKS = "\n\t\xa0\u202f"


class InputError(ValueError):
    """Bad input; its text is one sentence for the user. The command line prints it and exits with 2."""

    def __init__(self, *said: object) -> None:
        """Names of damaged files are in it: what no terminal takes is written as \\x1b, what is long is cut."""
        super().__init__(*(readable(s) if isinstance(s, str) else s for s in said))


class TooFewSamplesError(InputError):
    """A record with fewer samples than the `least` that the free parameters of a structure need."""

    def __init__(self, said: str, parameters: int, least: int, structure: str) -> None:
        super().__init__(said)
        self.parameters, self.least, self.structure = parameters, least, structure


def printable(text: str) -> str:
    """The text with what steers a terminal, or turns the direction of reading, written as \\x1b or \\u202e."""
    return text if text.isprintable() else _OTHER.sub(_escaped, text)


def readable(text: str) -> str:
    """The text as it is shown, on every way out: `printable`, and words and lines that are too long cut."""
    text = printable(text)
    if len(text) < WORD:
        return text
    text = _LONG_WORD.sub(lambda word: f"{word[0][:200]}...{word[0][-200:]}", text)
    return _LONG_LINE.sub(lambda line: f"{line[0][: TEXT // 2]} ... {line[0][-TEXT // 2 :]}", text)


def readable_values(value: Any) -> Any:
    """A document of JSON with all its texts and names `readable`."""
    if isinstance(value, str):
        return readable(value)
    if isinstance(value, dict):
        return {readable_values(key): readable_values(entry) for key, entry in value.items()}
    return [readable_values(entry) for entry in value] if isinstance(value, list) else value


_OTHER = re.compile(r"[^\n\t -~]")  # what may have to be escaped; letters of other alphabets are among it
_LONG_WORD, _LONG_LINE = re.compile(rf"\S{{{WORD},}}"), re.compile(rf".{{{TEXT + 1},}}")


def _escaped(match: re.Match[str]) -> str:
    c = match[0]
    return c if c.isprintable() or c in BLANKS else ascii(c)[1:-1]


def unknown(what: str, got: str, allowed: Iterable[str]) -> InputError:
    """The error for a name that is not in a table: unknown joint 'knee'; choose one of shoulder, thigh, shank."""
    return InputError(f"unknown {what} {got!r}; choose one of {', '.join(allowed)}")

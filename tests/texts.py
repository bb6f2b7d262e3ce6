"""Text that acts on who shows it, and a search for it."""

import re

# Colours, rings, writes over its line, turns the direction of reading, hides, breaks the line, opens a C1 sequence.
HOSTILE = "a\x1b[31m\x07\rb\x08\x7f\u202ec\u2066\u200b\u2028\x9b1md"
LONG = "a" * 10_000
# All of what Unicode calls control, format, separator of lines, surrogate or private but \t, \n and blanks.
ACTS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]")


def acting(text: str) -> bool:
    """Whether a text holds a character that steers who shows it."""
    return ACTS.search(text) is not None

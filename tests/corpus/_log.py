"""What an entry of the corpus is: a file as it lies on the disk, and beside it the right numbers or sentence."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# The rig that most logs recorded: twelve samples, 0.1 s apart.
T = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1)
U = (0.5, 0.5, -1.0, -1.0, 2.0, 2.0, 1.5, 1.5, -2.0, -2.0, 0.0, 1.0)
Y = (1.25, 0.75, -0.5, -1.5, 0.25, 2.0, 3.5, 3.0, 1.0, -1.0, -2.25, -1.75)
TS = 0.1


@dataclass(frozen=True)
class Right:
    """The record: u and y in SI, one tuple a channel, and Ts [s]. `or_refused`: a sentence does as well."""

    u: tuple[float, ...] = U
    y: tuple[float, ...] = Y
    Ts: float = TS
    or_refused: bool = False


@dataclass(frozen=True)
class Refused:
    """A sentence that holds these fragments."""

    fragments: tuple[str, ...]


@dataclass(frozen=True)
class Log:
    """A file called `file` with `content`, read with `options`; `beside` are other files of its folder.

    `fails` is the reason of a strict expected failure: what is not right yet.
    """

    file: str
    content: bytes
    answer: Right | Refused
    options: Mapping[str, Any] = field(default_factory=dict)
    beside: Mapping[str, bytes] = field(default_factory=dict)
    fails: str = ""


RIGHT = Right()
SAFE = Right(or_refused=True)  # never promised to be readable, but never other numbers


def log(
    content: str | bytes, answer: Right | Refused = RIGHT, file: str = "a.csv", fails: str = "", **options: Any
) -> Log:
    """An entry whose text is UTF-8."""
    beside = options.pop("beside", {})
    return Log(file, content.encode() if isinstance(content, str) else content, answer, options, beside, fails)


def refused(*fragments: str) -> Refused:
    """A sentence with these fragments."""
    return Refused(fragments)


# The rows of the rig, as they stand in most files.
ROWS = """\
0.0,0.5,1.25
0.1,0.5,0.75
0.2,-1,-0.5
0.3,-1,-1.5
0.4,2,0.25
0.5,2,2
0.6,1.5,3.5
0.7,1.5,3
0.8,-2,1
0.9,-2,-1
1.0,0,-2.25
1.1,1,-1.75
"""
PAIRS = "".join(line.partition(",")[2] + "\n" for line in ROWS.splitlines())  # without the time: 0.5,1.25 and so on
SEMI = ROWS.replace(",", ";").replace(".", ",")  # 0,0;0,5;1,25
TABS = ROWS.replace(",", "\t")


def with_row(number: int, row: str, rows: str = ROWS) -> str:
    """The rows with another text in row `number`, counted from 1; "" takes it out."""
    lines = rows.splitlines(keepends=True)
    lines[number - 1] = row + "\n" if row else ""
    return "".join(lines)


def stamped(stamps: str | list[str], mark: str = ",") -> str:
    """The rows with other time stamps: a blank between them."""
    words = stamps.split() if isinstance(stamps, str) else stamps
    return "".join(f"{stamp}{mark}{u:g}{mark}{y:g}\n" for stamp, u, y in zip(words, U, Y, strict=True))

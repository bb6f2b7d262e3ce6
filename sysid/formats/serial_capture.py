"""What a microcontroller printed: lines of numbers, with start-up messages and garbled lines among them."""

import re
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._clock import misfits, misspelt
from sysid.formats._units import units_of

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)"
PLAIN = {  # by the mark between the numbers; none is blanks
    mark: re.compile(rf"(?:{NUMBER})(?:{between}(?:{NUMBER}))*", re.IGNORECASE)
    for mark, between in ((",", " *, *"), (";", " *; *"), ("", "[ \\t]+"))
}
PAIRS = re.compile(rf"[A-Za-z]\w* *[=:] *(?i:{NUMBER})(?:[ ,;\t]+[A-Za-z]\w* *[=:] *(?i:{NUMBER}))*")
PAIR = re.compile(rf"([A-Za-z]\w*) *[=:] *((?i:{NUMBER}))")
STAMP = re.compile(r"\[?(?:\d{4}-\d\d-\d\d[ T])?\d\d:\d\d:\d\d(?:[.,]\d+)?\]?(?: ->)? +")  # a terminal program's own
MOST_GARBLED = 0.1
UNIFORM = 0.99  # part of the lines that print a column with the same decimals, so that the others lost some
SHOWN = 20  # row numbers in a note


@dataclass(frozen=True, slots=True)
class Line:
    """A line that has numbers and nothing else: its row, its shape (the mark and how many, or the keys), its texts."""

    row: int
    shape: tuple[str, ...]
    cells: tuple[str, ...]


class SerialCapture:
    """Reads .log: lines such as `12034,512,-87`, `12034 512 -87` or `t=12034 adc=512`, one a sample.

    Lines that do not have the shape of the majority are left out, and their rows are in `notes`: start-up messages,
    lines with lost characters, two lines run together. So are lines whose numbers have fewer decimals than the others',
    whose clock does not lie between those of the lines beside it, and those with a number that stands off and has a
    digit more or less than the ones beside it. What fits its neighbours cannot be seen to be wrong: a changed last
    digit, or a line that ends in the rest of the next. A line above the first numbers that has a word for each is the
    names.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".log",)
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """The samples in `path`; raises InputError if more than a tenth of the lines below the first sample is not."""
        texts = path.read_bytes().decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
        lines = [line for row, text in enumerate(texts, start=1) if (line := _line(row, text))]
        shapes = Counter(line.shape for line in lines)
        if not shapes:
            raise InputError(f"{path} is not a capture of samples: no line has numbers alone; give one sample a line")
        shape = shapes.most_common(1)[0][0]
        samples = [line for line in lines if line.shape == shape]
        notes: list[str] = []
        samples = self._without_garbled(path, texts, samples, notes)
        names = _names(texts, samples[0], shape) or [str(j + 1) for j in range(len(samples[0].cells))]
        samples, values = _without_misfits(samples, names, notes)
        rows = array("q", [line.row for line in samples])
        return Table(
            path, tuple(names), tuple(values.T), (rows,) * len(names), units=units_of(names), notes=tuple(notes)
        )

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Never called: no suffix is written."""
        raise NotImplementedError

    def header(self, path: Path) -> str:
        """None: a microcontroller keeps no header."""
        return ""

    def _without_garbled(self, path: Path, texts: list[str], samples: list[Line], notes: list[str]) -> list[Line]:
        """The samples that are whole, as far as each line alone shows it."""
        first = samples[0].row
        if first > 1:
            notes.append(f"skipped what stands above the first sample, which is in row {first}")
        if texts[-1] and samples[-1].row == len(texts) and len(samples) > 1:
            notes.append(f"left out row {samples[-1].row}, the last, which has no line end and may be cut off")
            samples = samples[:-1]
        odd = _odd_decimals(samples)
        whole = [line for line in samples if line.row not in odd]
        kept = {line.row for line in whole}
        garbled = [row for row in range(first, samples[-1].row + 1) if row not in kept and texts[row - 1].strip()]
        total = len(garbled) + len(whole)
        if len(garbled) > MOST_GARBLED * total:
            raise InputError(
                f"{path}, row {garbled[0]}: found {texts[garbled[0] - 1].strip()[:40]!r}, and {len(garbled)} of "
                f"{total} lines are not like the majority, more than a tenth; check the baud rate and record it again"
            )
        if garbled:
            notes.append(f"left out {_counted(garbled, 'garbled line')}")
        return whole


def looks_like_one(block: bytes) -> bool:
    """Whether most of the first lines are pairs such as adc=512, or have a terminal program's time in front."""
    lines = [line for line in block.decode("latin-1").split("\n")[:200] if line.strip()]
    hits = [line for line in lines if PAIRS.fullmatch(_bare(line)) or (STAMP.match(line) and "->" in line)]
    return len(hits) * 2 > len(lines)


def _bare(text: str) -> str:
    text = text.strip()
    stamp = STAMP.match(text) if ":" in text else None
    return text[stamp.end() :] if stamp else text


def _line(row: int, text: str) -> Line | None:
    text = _bare(text)
    mark = "," if "," in text else ";" if ";" in text else ""
    if PLAIN[mark].fullmatch(text):
        cells = tuple(text.replace(" ", "").split(mark) if mark else text.split())
        return Line(row, (mark, str(len(cells))), cells)
    if PAIRS.fullmatch(text):
        pairs = PAIR.findall(text)
        keys = tuple(key for key, _ in pairs)
        return Line(row, keys, tuple(cell for _, cell in pairs)) if len(set(keys)) == len(keys) else None
    return None


def _names(texts: list[str], first: Line, shape: tuple[str, ...]) -> list[str] | None:
    """The keys of the pairs, or the words of the last line above the first sample that has one for each number."""
    if len(shape) != 2 or not shape[1].isdigit():
        return list(shape)
    for text in reversed(texts[: first.row - 1]):
        words = [word.strip(" \t\"'#%") for word in _bare(text).lstrip("#% ").split(shape[0] or None)]
        if len(words) == len(first.cells) and len(set(words)) == len(words):
            named = all(re.match(r"[^\W\d]", word) and word.isprintable() for word in words)
            return words if named else None
    return None


def _odd_decimals(samples: Sequence[Line]) -> set[int]:
    """Rows of the lines that print a column with other decimals than nearly all lines do."""
    odd: set[int] = set()
    for j in range(len(samples[0].cells)):
        decimals = [len(line.cells[j].partition(".")[2]) for line in samples]
        usual, count = Counter(decimals).most_common(1)[0]
        if UNIFORM * len(samples) <= count < len(samples):
            odd |= {
                line.row
                for line, each in zip(samples, decimals, strict=True)
                if each != usual and line.cells[j].lstrip("+-").lower() not in ("nan", "inf")
            }
    return odd


def _without_misfits(samples: list[Line], names: list[str], notes: list[str]) -> tuple[list[Line], np.ndarray]:
    """Samples, and their numbers (N, columns), without those that the lines beside them show to be wrong."""
    values = np.array([[float(cell) for cell in line.cells] for line in samples])
    clock, wrong = misfits(values, names)
    if clock is None and samples[0].row == 1 and len(samples) > 1:
        wrong[0] = True
        notes.append("left out row 1, the first, which may be cut off at its start")
    elif wrong.any():
        rows = [line.row for line, bad in zip(samples, wrong, strict=True) if bad]
        notes.append(f"left out {_counted(rows, 'line')} whose {names[clock or 0]!r} does not fit the lines beside it")
    lossy = (clock is not None and bool(wrong.any())) or any("garbled" in note for note in notes)
    samples = [line for line, bad in zip(samples, wrong, strict=True) if not bad]
    values = values[~wrong]
    spoilt = np.zeros(len(values), dtype=bool)
    for j in range(values.shape[1]):
        if j != clock:
            spoilt |= misspelt(values[:, j], [line.cells[j] for line in samples], lossy)
    if spoilt.any():
        rows = [line.row for line, bad in zip(samples, spoilt, strict=True) if bad]
        notes.append(f"left out {_counted(rows, 'line')} with a number that lost or gained a character")
    return [line for line, bad in zip(samples, spoilt, strict=True) if not bad], values[~spoilt]


def _counted(rows: Sequence[int], what: str) -> str:
    shown = ", ".join(map(str, rows[:SHOWN])) + (f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else "")
    return f"{len(rows)} {what}{'' if len(rows) == 1 else 's'} (row{'' if len(rows) == 1 else 's'} {shown})"

"""What a microcontroller printed: lines of numbers, with start-up messages and garbled lines among them."""

import re
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._format import Format
from sysid.formats._unit_names import units_of

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)"
PLAIN = {  # by the mark between the numbers; none is blanks
    mark: re.compile(rf"(?:{NUMBER})(?:{between}(?:{NUMBER}))*", re.IGNORECASE)
    for mark, between in ((",", " *, *"), (";", " *; *"), ("", "[ \\t]+"))
}
PAIRS = re.compile(rf"[A-Za-z]\w* *[=:] *(?i:{NUMBER})(?:[ ,;\t]+[A-Za-z]\w* *[=:] *(?i:{NUMBER}))*")
PAIR = re.compile(rf"([A-Za-z]\w*) *[=:] *((?i:{NUMBER}))")
STAMP = re.compile(r"\[?(?:\d{4}-\d\d-\d\d[ T])?\d\d:\d\d:\d\d(?:[.,]\d+)?\]?(?: ->)? +")  # a terminal program's own
# Limits chosen by hand; the logs of tests/corpus hold them.
MOST_GARBLED = 0.1
UNIFORM = 0.99  # part of the lines that print a column with the same decimals, so that the others lost some
BANNER = 50  # lines of text that a board prints as it starts or stops
FEW = 3  # lines of one other form at an end: the firmware or its sensors changed, no character was lost
SHOWN = 20  # row numbers in a note


@dataclass(frozen=True, slots=True)
class Line:
    """A line that has numbers and nothing else: its row, its shape (the mark and how many, or the keys), its texts."""

    row: int
    shape: tuple[str, ...]
    cells: tuple[str, ...]


class SerialCapture(Format):
    """Reads .log: lines such as `12034,512,-87`, `12034 512 -87` or `t=12034 adc=512`, one a sample.

    Lines that do not have the shape of the majority are left out, and their rows are in `notes`: start-up messages,
    lines with lost characters, two lines run together. So are lines whose numbers have fewer decimals than the others',
    whose clock does not lie between those of the lines beside it, and those with a number that stands off and has a
    digit more or less than the ones beside it. What fits its neighbours cannot be seen to be wrong: a changed last
    digit, or a line that ends in the rest of the next. A line above the first numbers that has a word for each is the
    names. A record whose lines begin or end in another form is refused.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".log",)
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """The samples in `path`; raises InputError if more than a tenth of the lines is garbled."""
        texts = path.read_bytes().decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
        lines = [line for row, text in enumerate(texts, start=1) if (line := _line(row, text))]
        shapes = Counter(line.shape for line in lines)
        if not shapes:
            raise InputError(f"{path} is not a capture of samples: no line has numbers alone; give one sample a line")
        shape = shapes.most_common(1)[0][0]
        samples = [line for line in lines if line.shape == shape]
        notes: list[str] = []
        names_row, names = _names(texts, samples, shape)
        if names_row > samples[0].row:  # what stands above the names is no sample: a version, a calibration
            samples = [line for line in samples if line.row > names_row]
        first, last = samples[0].row, samples[-1].row
        rows_above = [row for row in range(names_row + 1, first) if texts[row - 1].strip()]
        rows_below = [row for row in range(last + 1, len(texts) + 1) if texts[row - 1].strip()]
        _check_form(path, texts, lines, samples, (*rows_above, *rows_below))
        samples = self._drop_garbled(path, texts, samples, (rows_above, rows_below), notes)
        names = names or [str(j + 1) for j in range(len(samples[0].cells))]
        samples, values = _drop_misfits(samples, names, notes)
        rows = array("q", [line.row for line in samples])
        return Table(
            path, tuple(names), tuple(values.T), (rows,) * len(names), units=units_of(names), notes=tuple(notes)
        )

    def _drop_garbled(
        self, path: Path, texts: list[str], samples: list[Line], ends: tuple[list[int], list[int]], notes: list[str]
    ) -> list[Line]:
        """The samples that are whole, as far as each line alone shows it; `ends` are the rows outside them."""
        first, last = samples[0].row, samples[-1].row
        rows_above, rows_below = (_garbled_rows(rows, texts, samples[0]) for rows in ends)
        if first > 1:
            notes.append(f"skipped what stands above the first sample, which is in row {first}")
        if texts[-1].strip() and len(samples) > 1:
            notes.append(f"left out row {len(texts)}, the last, which has no line end and may be cut off")
            samples = samples[:-1] if last == len(texts) else samples
            rows_below = [row for row in rows_below if row < len(texts)]
        odd = _odd_decimals(samples)
        whole_lines = [line for line in samples if line.row not in odd]
        sample_rows = {line.row for line in whole_lines}
        rows_between = [
            row for row in range(first, samples[-1].row + 1) if row not in sample_rows and texts[row - 1].strip()
        ]
        garbled = [*rows_above, *rows_between, *rows_below]
        total = len(garbled) + len(whole_lines)
        if len(garbled) > MOST_GARBLED * total:
            raise InputError(
                f"{path}, row {garbled[0]}: found {texts[garbled[0] - 1].strip()[:40]!r}, and {len(garbled)} of "
                f"{total} lines are not like the majority, more than a tenth; check the baud rate and record it again, "
                "or keep the lines of one form alone"
            )
        if garbled:
            notes.append(f"left out {_count_rows(garbled, 'garbled line')}")
        if text_rows := [row for row in ends[1] if row not in rows_below and row < len(texts)]:
            notes.append(f"left out {_count_rows(text_rows, 'line')} of text below the last sample")
        return whole_lines


def looks_like_one(block: bytes) -> bool:
    """Whether most of the first lines are pairs such as adc=512, or have a terminal program's time in front."""
    lines = [line for line in block.decode("latin-1").split("\n")[:200] if line.strip()]
    hits = [line for line in lines if PAIRS.fullmatch(_without_stamp(line)) or (STAMP.match(line) and "->" in line)]
    return len(hits) * 2 > len(lines)


def _without_stamp(text: str) -> str:
    text = text.strip()
    stamp = STAMP.match(text) if ":" in text else None
    return text[stamp.end() :] if stamp else text


def _line(row: int, text: str) -> Line | None:
    """A line of numbers alone, or of pairs; None for another text."""
    text = _without_last_mark(_without_stamp(text))
    mark = "," if "," in text else ";" if ";" in text else ""
    if PLAIN[mark].fullmatch(text):
        cells = tuple(text.replace(" ", "").split(mark) if mark else text.split())
        return Line(row, (mark, str(len(cells))), cells)
    if PAIRS.fullmatch(text):
        pairs = PAIR.findall(text)
        keys = tuple(key for key, _ in pairs)
        return Line(row, keys, tuple(cell for _, cell in pairs)) if len(set(keys)) == len(keys) else None
    return None


def _check_form(
    path: Path, texts: list[str], lines: Sequence[Line], samples: Sequence[Line], ends: Sequence[int]
) -> None:
    """Raises InputError for a record whose first or last lines are whole samples too, but of another form."""
    end_rows = set(ends)
    other_lines = [line for line in lines if line.row in end_rows and len(line.cells) > 1]
    for shape, count in Counter(line.shape for line in other_lines).items():
        if count >= FEW and len(samples[0].cells) > 1:
            row = next(line.row for line in other_lines if line.shape == shape)
            raise InputError(
                f"{path}, row {row}: found {texts[row - 1].strip()[:40]!r}, where row {samples[0].row} has "
                f"{texts[samples[0].row - 1].strip()[:40]!r}, and {count} lines at this end of the file are like it: "
                "the form of the samples changes within the file; save the lines of each form as a file of their own"
            )


def _garbled_rows(rows: Sequence[int], texts: list[str], sample: Line) -> list[int]:
    """Those of the rows outside the samples that are samples which lost something; all, if text is too long for words
    of a board as it starts or stops."""
    similar = [row for row in rows if _like(_without_stamp(texts[row - 1]), sample)]
    return list(rows) if len(rows) - len(similar) > BANNER else similar


def _like(text: str, sample: Line) -> bool:
    """Whether a text begins as the sample does, and has as many cells: 120,5,--- or t:120 u:5 y:---."""
    if not _is_plain(sample.shape):
        return re.match(rf"{re.escape(sample.shape[0])} *[=:]", text) is not None
    cells = text.split(sample.shape[0] or None)
    return len(cells) == len(sample.cells) > 1 and re.fullmatch(NUMBER, cells[0].strip(), re.IGNORECASE) is not None


def _is_plain(shape: tuple[str, ...]) -> bool:
    return len(shape) == 2 and shape[1].isdigit()


def _names(texts: list[str], samples: Sequence[Line], shape: tuple[str, ...]) -> tuple[int, list[str] | None]:
    """The keys of the pairs, or the words of the last line above the samples that has one for each number.

    With the row of that line, 0 for none. A few lines of numbers may stand above the names.
    """
    if not _is_plain(shape):
        return 0, list(shape)
    first = samples[0]
    for row in (*range(first.row - 1, 0, -1), *range(first.row + 1, samples[min(FEW, len(samples) - 1)].row)):
        words = _words(texts[row - 1], shape[0])
        words = words if len(words) == len(first.cells) else _words(texts[row - 1], "\t")
        if len(words) == len(first.cells) and len(set(words)) == len(words):
            if all(re.match(r"[^\W\d]", word) and word.isprintable() for word in words):
                return row, words
            if row < first.row:
                return 0, None
    return 0, None


def _words(text: str, mark: str) -> list[str]:
    text = _without_last_mark(_without_stamp(text)).lstrip("#% ")
    return [word.strip(" \t\"'#%") for word in text.split(mark or None)]


def _without_last_mark(text: str) -> str:
    """The line without a mark behind its last number, which some programs print."""
    return text[:-1] if text.endswith((",", ";")) else text


def _odd_decimals(samples: Sequence[Line]) -> set[int]:
    """Rows of the lines that print a column with other decimals than nearly all lines do."""
    odd: set[int] = set()
    for j in range(len(samples[0].cells)):
        decimals = [len(line.cells[j].partition(".")[2]) for line in samples]
        usual, count = Counter(decimals).most_common(1)[0]
        if UNIFORM * len(samples) <= count < len(samples):
            odd |= {
                line.row
                for line, count_of_decimals in zip(samples, decimals, strict=True)
                if count_of_decimals != usual and line.cells[j].lstrip("+-").lower() not in ("nan", "inf")
            }
    return odd


def _drop_misfits(samples: list[Line], names: list[str], notes: list[str]) -> tuple[list[Line], np.ndarray]:
    """Samples, and their numbers (N, columns), without those that the lines beside them show to be wrong."""
    values = np.array([[float(cell) for cell in line.cells] for line in samples])
    clock, wrong = find_misfits(values, names)
    if clock is None and samples[0].row == 1 and len(samples) > 1:
        wrong[0] = True
        notes.append("left out row 1, the first, which may be cut off at its start")
    elif wrong.any():
        rows = [line.row for line, bad in zip(samples, wrong, strict=True) if bad]
        notes.append(
            f"left out {_count_rows(rows, 'line')} whose {names[clock or 0]!r} does not fit the lines beside it"
        )
    lossy = (clock is not None and bool(wrong.any())) or any("garbled" in note for note in notes)
    samples = [line for line, bad in zip(samples, wrong, strict=True) if not bad]
    values = values[~wrong]
    misspelt_lines = np.zeros(len(values), dtype=bool)
    for j in range(values.shape[1]):
        if j != clock:
            misspelt_lines |= misspelt_values(values[:, j], [line.cells[j] for line in samples], lossy)
    if misspelt_lines.any():
        rows = [line.row for line, bad in zip(samples, misspelt_lines, strict=True) if bad]
        notes.append(f"left out {_count_rows(rows, 'line')} with a number that lost or gained a character")
    return [line for line, bad in zip(samples, misspelt_lines, strict=True) if not bad], values[~misspelt_lines]


def _count_rows(rows: Sequence[int], noun: str) -> str:
    numbers = ", ".join(map(str, rows[:SHOWN])) + (f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else "")
    return f"{len(rows)} {noun}{'' if len(rows) == 1 else 's'} (row{'' if len(rows) == 1 else 's'} {numbers})"


CLOCKS = ("t", "time", "ms", "us", "millis", "micros", "clock", "stamp", "timestamp", "tick", "ticks", "t_ms", "t_us")
# Limits chosen by hand; the logs of tests/corpus hold them.
RISING = 0.9  # part of the steps of a clock that rise, whatever was garbled
GAP = 10.0  # middle steps: a longer one is a gap, and is believed only if the clock goes on from there
ISLAND = 3
SPIKE = 8.0  # how far a lone value stands off, in steps that the signal makes
RARE = 0.02  # a spike that occurs oftener is the signal's own


def find_misfits(values: np.ndarray, names: Sequence[str]) -> tuple[int | None, np.ndarray]:
    """The column of the clock, None if there is none, and which rows of `values` (N, columns) have a wrong one (N,)."""
    wrong = np.zeros(len(values), dtype=bool)
    j = _clock_column(values, names)
    if j is None:
        return None, wrong
    t = values[:, j]
    steps = np.diff(t)
    longest = GAP * np.median(steps[steps > 0])
    for _ in range(3):  # two wrong lines in a row hide behind each other
        places = np.flatnonzero(~wrong)
        last_stamp, middle, next_stamp = t[places[:-2]], t[places[1:-1]], t[places[2:]]
        is_enclosed = (next_stamp > last_stamp) & (next_stamp - last_stamp <= 2 * longest)
        is_outside = is_enclosed & ((middle < last_stamp) | (middle > next_stamp))
        if not is_outside.any():
            break
        wrong[places[1:-1][is_outside]] = True
    places = np.flatnonzero(~wrong)
    wrong[places[_islands(t[places], longest)]] = True
    return j, wrong


def _clock_column(values: np.ndarray, names: Sequence[str]) -> int | None:
    by_name = [j for j, name in enumerate(names) if name.lower() in CLOCKS]
    for j in [*by_name, 0]:
        steps = np.diff(values[:, j])
        if len(steps) > 3 and (steps > 0).mean() >= RISING and np.isfinite(steps).all():
            return j
    return None


def _islands(t: np.ndarray, longest: float) -> np.ndarray:
    """Which stamps (N,) the clock visits only briefly: up to `ISLAND` in a row, before it goes on as it was.

    A gap, a wrap or a restart goes on from there, so it is no island; a lone stamp at an end is one.
    """
    steps = np.diff(t)
    ends = np.flatnonzero((steps < 0) | (steps > longest)) + 1
    starts, stops = np.r_[0, ends], np.r_[ends, len(t)]
    wrong = np.zeros(len(t), dtype=bool)
    last = None  # the last stamp of the run before that was believed
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        next_stamp = t[stop] if stop < len(t) else None
        lone = stop - start == 1 and (last is None or next_stamp is None) and len(starts) > 1
        back = last is not None and next_stamp is not None and 0 <= next_stamp - last <= (ISLAND + 1) * longest
        if lone or (stop - start <= ISLAND and back):
            wrong[start:stop] = True
        else:
            last = t[stop - 1]
    return wrong


def misspelt_values(values: np.ndarray, texts: Sequence[str], signs: bool) -> np.ndarray:
    """Which values (N,) are lone spikes that one character explains: 51 or 5123 between 512 and 514.

    With `signs` also 87 between -88 and -86, which a signal may do as well; so only where other lines lost characters.
    """
    wrong = np.zeros(len(values), dtype=bool)
    if len(values) < 10 or not np.isfinite(values).all():
        return wrong
    preceding, middle, following = values[:-2], values[1:-1], values[2:]
    usual = max(3.0 * float(np.median(np.abs(np.diff(values)))), 1.0)
    alone = np.minimum(np.abs(middle - preceding), np.abs(middle - following)) > SPIKE * usual
    alone &= (np.sign(middle - preceding) == np.sign(middle - following)) & (np.abs(following - preceding) <= 2 * usual)
    longest = np.quantile([len(text.lstrip("+-")) for text in texts], 1 - RARE)
    for k in (np.flatnonzero(alone) + 1).tolist():
        low, high = sorted((values[k - 1], values[k + 1]))
        meant = any(low - usual <= number <= high + usual for number in _spellings(texts[k], signs))
        wrong[k] = meant or len(texts[k].lstrip("+-")) > longest + 1  # two numbers run together
    return wrong if wrong.mean() <= RARE else np.zeros(len(values), dtype=bool)


def _spellings(text: str, signs: bool) -> Iterator[float]:
    """The whole numbers that one more digit, one digit less, or a sign makes of `text`."""
    digits = text.lstrip("+-")
    sign = text[: len(text) - len(digits)]
    if digits.isdigit():
        for i in range(len(digits) + 1):
            yield from (float(sign + digits[:i] + digit + digits[i:]) for digit in "0123456789")
            if len(digits) > 1:
                yield float(sign + digits[:i] + digits[i + 1 :])
        if signs and not sign:
            yield -float(digits)

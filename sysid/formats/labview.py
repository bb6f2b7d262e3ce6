"""Text measurements of LabVIEW (.lvm), by the layout that NI publishes as "Specification for the LabVIEW Measurement
File". A header of the file, then segments: a header each (not always), a row of names, and rows of numbers.
"""

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table, is_number
from sysid.formats._cells import blocks
from sysid.formats._format import Format
from sysid.formats._groups import Group, table_of_groups

FIRST = "LabVIEW Measurement"
END = "***End_of_Header***"
SPECIAL = ("***Start_Special***", "***End_Special***")
SEPARATORS = {"tab": "\t", "comma": ","}


@dataclass
class Segment:
    """Rows of numbers under one header: its entries by key (one cell a channel), the names of its columns, its rows."""

    header: dict[str, list[str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)


class LabView(Format):
    """Reads .lvm with one column of times, one for each channel, or none (then start and step are in the header).

    Segments follow each other; the dates in their headers say how far apart they are.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".lvm",)
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """The channels in `path`; raises InputError with the row of a cell that is no number."""
        texts = [block.decode() for _, block in blocks(path)]
        lines = [line for text in texts for line in text.removesuffix("\n").split("\n")]
        separator = "," if lines and lines[0].startswith(f"{FIRST},") else "\t"
        if not lines or lines[0].split(separator)[0].strip() != FIRST:
            raise InputError(
                f"{path} is not a readable LVM file: it does not begin with {FIRST!r}; export it again, or rename it "
                "if it is a table"
            )
        head, start = _header(lines, 0, separator)
        separator = SEPARATORS.get(_entry(head, "Separator").lower(), separator)
        decimal = _entry(head, "Decimal_Separator") or "."
        segments = _segments(path, lines, start, separator, decimal)
        if not segments:
            raise InputError(f"{path} has no rows of numbers; record again, or give a file with one row a sample")
        kind = (_entry(head, "X_Columns") or "One").lower()
        uncut = texts[-1].endswith("\n")
        notes = () if uncut else ("the last row has no line end; if the file was cut there, its last number is wrong",)
        return table_of_groups(path, _groups(path, segments, kind, head, decimal), "sample", notes)


def _header(lines: list[str], start: int, separator: str) -> tuple[dict[str, list[str]], int]:
    """The entries of a header and the line behind its end."""
    header: dict[str, list[str]] = {}
    for k in range(start, len(lines)):
        key, *cells = (cell.strip() for cell in lines[k].split(separator))
        if key == END:
            return header, k + 1
        header[key] = cells
    return header, len(lines)


def _entry(header: dict[str, list[str]], key: str, k: int = 0) -> str:
    cells = header.get(key, [])
    return cells[k] if k < len(cells) else ""


def _segments(path: Path, lines: list[str], k: int, separator: str, decimal: str) -> list[Segment]:
    """The segments from line k on; one without rows is left out."""
    segments = [Segment()]
    while k < len(lines):
        cells = [cell.strip() for cell in lines[k].split(separator)]
        if cells[0] == SPECIAL[0]:
            k = next((j for j in range(k, len(lines)) if lines[j].startswith(SPECIAL[1])), len(lines))
        elif cells[0] == "Channels":
            header, k = _header(lines, k, separator)
            segments.append(Segment(header))
            continue
        elif cells[0] == "X_Value":
            segments += [Segment(segments[-1].header)] if segments[-1].rows else []
            segments[-1].names = cells
        elif any(cells) and segments[-1].names:
            segments[-1].rows.append(_row(path, k + 1, cells, segments[-1].names, decimal))
        k += 1
    return [segment for segment in segments if segment.rows]


def _row(path: Path, number: int, cells: list[str], names: list[str], decimal: str) -> list[float]:
    """The numbers of a row, nan for empty cells; what stands under Comment is no number."""
    count = len(names) - (names[-1] == "Comment")
    values = []
    for name, cell in zip(names[:count], [*cells, *[""] * count][:count], strict=True):
        text = cell.replace(decimal, ".")
        if text and not is_number(text):
            raise InputError(
                f"{path}, row {number}, column {name!r}: found {cell[:40]!r}, which is not a number; correct the cell"
            )
        values.append(float(text) if text else np.nan)
    return values


def _groups(path: Path, segments: list[Segment], kind: str, head: dict[str, list[str]], decimal: str) -> list[Group]:
    """The channels of all segments behind each other, each with its times."""
    names, first = segments[0].names, segments[0]
    count = len(names) - (names[-1] == "Comment")
    if any(segment.names != names for segment in segments):
        raise InputError(f"{path} has segments of other channels ({', '.join(names[:count])}); split it at its headers")
    places = range(1, count, 2) if kind == "multi" else range(1, count)
    start = _date(first.header, head, 0)  # of the first channel
    groups: list[Group] = []
    for k, j in enumerate(places):
        times, values = [], []
        for segment in segments:
            date = _date(segment.header, head, k)
            rows = np.array(segment.rows, dtype=float)
            filled = np.isfinite(rows[:, j])
            shift = (date - start).total_seconds() if date and start else 0.0
            x0, step = (
                float(_entry(segment.header, key, k).replace(decimal, ".") or "nan") for key in ("X0", "Delta_X")
            )
            x = rows[:, j - 1 if kind == "multi" else 0] if kind != "no" else x0 + step * np.arange(len(rows))
            times.append(x[filled] + shift)
            values.append(rows[filled, j])
        t = np.concatenate(times)
        group = next((each for each in groups if each.t is not None and np.array_equal(each.t, t)), None)
        if group is None:
            group = Group(names[j], t)
            groups.append(group)
        name = names[j] if names.count(names[j]) == 1 else f"{names[j]}:{k + 1}"
        group.channels[name] = np.concatenate(values)
        group.units[name] = _entry(first.header, "Y_Unit_Label", k)
    return groups


def _date(header: dict[str, list[str]], head: dict[str, list[str]], k: int) -> datetime | None:
    """When channel k of a segment begins, as its header or the file's says."""
    stated = [[cell for cell in header.get(key, []) if cell] or [_entry(head, key)] for key in ("Date", "Time")]
    date, time = (cells[min(k, len(cells) - 1)] for cells in stated)  # one for all channels, or one for each
    whole, _, part = time.replace(",", ".").partition(".")
    try:
        return datetime.strptime(f"{date} {whole}.{part[:6] or 0}", "%Y/%m/%d %H:%M:%S.%f")
    except ValueError:
        return None

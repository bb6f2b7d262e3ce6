"""Exports of oscilloscopes: tables of text with a preamble above or beside the numbers.

Rigol has names, then `Sequence,Volt,...` with start and increment; Siglent and Tektronix have lines of settings, then
names; older Tektronix have the settings in the first three columns; Keysight has names, then `second,Volt`; LeCroy has
`Segments,1,SegmentSize,502`, then `Time,Ampl`, a time [s] and a number without a unit. Yokogawa has no times: those are
HResolution (n - 1) + HOffset for the nth row (user's manual IM DLM3054-01EN, appendix 3, ASCII data file format).
Infiniium of Keysight has settings with an entry for each source, then `Data`, then values alone, or times beside them
(Infiniium 90000 Series Programmer's Reference, CSV and TSV header format).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table, is_number

SETTINGS = {  # of a preamble, in small letters: one of them says that it is one
    *("record length", "sample interval", "trigger point", "source", "vertical units", "vertical scale", "sample rate"),
    *("horizontal units", "horizontal scale", "model", "model number", "firmware version", "waveform type", "points"),
    "segments",
}
UNITS = {
    "second": "s",
    "seconds": "s",
    "s": "s",
    "volt": "V",
    "volts": "V",
    "v": "V",
    "ampere": "A",
    "amp": "A",
    "a": "A",
}
TIMES = ("time", "x-axis", "x", "second", "source", "t", "time(s)")  # names of the first column, in small letters
SIDE = 3  # columns of settings beside the numbers
FEW = 3  # rows of numbers that show where they begin


@dataclass(frozen=True)
class Preamble:
    """What stands above the numbers: names and units of their columns, the cells of a row, the index of the first row.

    `start` and `increment` [s] are those of a column that counts samples; `side` are columns that hold settings.
    """

    names: tuple[str, ...]
    units: dict[str, str]
    width: int
    first: int
    start: float = 0.0
    increment: float | None = None
    side: int = 0
    text: str = ""
    timeless: bool = False  # no column counts samples: the rows do

    def finished(self, table: Table) -> Table:
        """The table without the columns of settings, with times in place of counts, and a note."""
        keep = range(self.side, len(table.names))
        columns = [table.columns[j] for j in keep]
        names, rows = [table.names[j] for j in keep], [table.rows[j] for j in keep]
        if self.timeless:
            names, rows = ["time", *names], [rows[0], *rows]
            columns.insert(0, np.arange(len(columns[0]), dtype=float))
        if self.increment is not None:
            counts = columns[0]
            if not isinstance(counts, np.ndarray):
                raise InputError(
                    f"{table.path}: column {table.names[0]!r} has cells that are no counts; export it again"
                )
            columns[0] = self.start + self.increment * counts
        return replace(
            table,
            names=tuple(names),
            columns=tuple(columns),
            rows=tuple(rows),
            units={name: unit for name, unit in self.units.items() if name in names},
            notes=(*table.notes, f"read as an instrument exports it: {self.text}"),
        )


def preamble_of(rows: Sequence[Sequence[str]]) -> Preamble | None:
    """The preamble in the first rows of a table by their cells; None of another table."""
    cells = [_stripped(row) for row in rows]
    return _beside(cells) or _counted(cells) or _timeless(cells) or _infiniium(cells) or _above(cells)


def _counted(rows: list[list[str]]) -> Preamble | None:
    """Rigol: X,CH1,CH2,Start,Increment and Sequence,Volt,Volt,-0.1,1e-4 above counts of samples."""
    if len(rows) < FEW or [cell.lower() for cell in rows[0][-2:]] != ["start", "increment"]:
        return None
    units, (start, increment) = rows[1][:-2], rows[1][-2:]
    if not (is_number(start) and is_number(increment)) or len(rows[1]) != len(rows[0]):
        return None
    names = ("time", *rows[0][1:-2])
    step = float(increment)
    text = f"{len(names) - 1} channel(s), a sample every {step:g} s"
    known = {name: _unit(unit) for name, unit in zip(names[1:], units[1:], strict=True)}
    return Preamble(names, {"time": "s", **known}, len(names), 2, float(start), step, text=text)


def _timeless(rows: list[list[str]]) -> Preamble | None:
    """Yokogawa: lines TraceName, VUnit, HResolution, HOffset and others, whose number stands first, then the traces."""
    settings = {row[0].lower(): row[1:] for row in rows if row[0] and not is_number(row[0])}
    if not {"header size", "tracename", "hresolution"} <= set(settings) or rows[0][0].lower() != "header size":
        return None
    traces = [name for name in settings["tracename"] if name]
    first = next((k for k, row in enumerate(rows) if row != [""] and _only_numbers(row)), None)
    times = [settings.get(key, ["0"])[:1] for key in ("hresolution", "hoffset")]
    side = len(rows[first]) - len(traces) if first is not None else -1
    if first is None or side not in (0, 1) or not traces or not all(t and is_number(t[0]) for t in times):
        return None
    increment, start = (float(t[0]) for t in times)
    texts = settings.get("vunit", [])
    units = {name: _unit(unit) for name, unit in zip(traces, texts, strict=False) if unit}
    horizontal = settings.get("hunit", ["s"])[:1] or ["s"]
    units["time"] = _unit(horizontal[0])
    names = (*(f"setting {k}" for k in range(1, side + 1)), *traces)
    text = f"{len(traces)} trace(s), a sample every {increment:g} {units['time']}"
    return Preamble(names, units, len(names), first, start, increment, side, text, True)


def _infiniium(rows: list[list[str]]) -> Preamble | None:
    """Infiniium: lines Revision, XInc, XOrg, YUnits and others of n entries, then rows of n values, or of times too."""
    settings = {row[0].lower().rstrip(":"): [cell for cell in row[1:] if cell] for row in rows if not is_number(row[0])}
    first = next((k for k, row in enumerate(rows) if row != [""] and all(map(is_number, row))), None)
    if first is None or not {"revision", "xinc", "xorg"} <= set(settings):
        return None
    steps, starts, n = settings["xinc"], settings["xorg"], len(settings["xinc"])
    width = len(rows[first])
    if not n or len(starts) != n or not all(map(is_number, (*steps, *starts))) or width not in (n, n + 1, 2 * n):
        return None
    if len({*map(float, steps)}) > 1 or (width == n and len({*map(float, starts)}) > 1):
        return None
    names = [f"CH{k}" for k in range(1, n + 1)]
    horizontal = _unit((settings.get("xunits") or ["s"])[0])
    units = {name: _unit(unit) for name, unit in zip(names, settings.get("yunits", []), strict=False)}
    times = ["time", *(f"time {k}" for k in range(2, n + 1))]
    units |= dict.fromkeys(times, horizontal)
    increment = float(steps[0])
    text = f"{n} source(s), a sample every {increment:g} {horizontal}"
    if width == n:
        return Preamble(tuple(names), units, width, first, float(starts[0]), increment, text=text, timeless=True)
    pairs = [name for pair in zip(times, names, strict=True) for name in pair]
    return Preamble(tuple(pairs if width == 2 * n else ["time", *names]), units, width, first, text=text)


def _only_numbers(row: list[str]) -> bool:
    """Whether all cells are numbers, but for the first, which may be empty."""
    return all(is_number(cell) for cell in row[1 if len(row) > 1 and not row[0] else 0 :])


def _beside(rows: list[list[str]]) -> Preamble | None:
    """Tektronix, older: Record Length,2500,,-0.1,0.04 with the numbers from the first row on."""
    if len(rows) < FEW or rows[0][0].lower() != "record length" or len(rows[0]) < SIDE + 2:
        return None
    width = len(rows[0])
    if any(len(row) != width or not all(map(is_number, row[SIDE:])) for row in rows):
        return None
    settings = {row[0].lower(): row[1] for row in rows if row[0]}
    source = settings.get("source", "CH1") or "CH1"
    names = tuple(f"setting {k}" for k in range(1, SIDE + 1))
    signals = (source, *(f"{source}:{k}" for k in range(2, width - SIDE)))[: width - SIDE - 1]
    unit = settings.get("vertical units", "")
    units = {"time": "s", **{name: _unit(unit) for name in signals if unit}}
    return Preamble((*names, "time", *signals), units, width, 0, side=SIDE, text=f"{source}, settings beside it")


def _above(rows: list[list[str]]) -> Preamble | None:
    """Lines of settings, rows of names and units, then numbers."""
    first = next((k for k in range(len(rows) - FEW) if all(_numeric(row, rows[k]) for row in rows[k : k + FEW])), None)
    if not first:
        return None
    width = len(rows[first])
    heads = [k for k in range(max(0, first - 3), first) if len(rows[k]) == width]
    named = [k for k in heads if rows[k][0].lower() in TIMES]
    settings = [row for row in rows[: named[0] if named else 0] if len(row) > 1 and row[0]]
    is_scope = len(settings) > 1 and any(row[0].lower().rstrip(":") in SETTINGS for row in settings)
    unit_rows = [k for k in heads if all(cell.lower() in UNITS for cell in rows[k])]
    if not named or not (is_scope or (unit_rows and rows[unit_rows[0]][0].lower().startswith("second"))):
        return None
    names_row = next((k for k in named if k not in unit_rows), None)
    cells = rows[names_row] if names_row is not None else ["time", *(f"CH{k}" for k in range(1, width))]
    names = ("time", *cells[1:])
    units = {"time": "s"}
    written = [k for k in heads if names_row is not None and k > names_row and any(rows[k])]  # of data loggers
    if written or unit_rows:
        row = rows[(unit_rows or written)[0]]
        units |= {name: _unit(cell) for name, cell in zip(names, row, strict=True) if cell}
    else:
        stated = {row[0].lower().rstrip(":"): row[1:] for row in settings}
        units["time"] = _unit(stated.get("horizontal units", ["s"])[0])
        vertical = stated.get("vertical units", [])
        units |= {name: _unit(cell) for name, cell in zip(names[1:], vertical, strict=False) if cell}
    text = f"{len(settings)} line(s) of settings above the numbers"
    return Preamble(names, units, width, first, text=text) if len(set(names)) == width else None


def _unit(text: str) -> str:
    return UNITS.get(text.lower(), text)


def _numeric(row: list[str], like: list[str]) -> bool:
    return len(row) == len(like) > 1 and all(map(is_number, row))


def _stripped(row: Sequence[str]) -> list[str]:
    """The cells of a row without the empty ones at its end."""
    cells = [cell.strip() for cell in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells or [""]

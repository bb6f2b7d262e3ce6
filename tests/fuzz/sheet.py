"""A text log whose right answer is known, and changes of it whose meaning is known."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

UNITS = {"V": 1.0, "mV": 1e-3, "kV": 1e3, "deg": np.pi / 180, "rad": 1.0, "mrad": 1e-3, "rev": 2 * np.pi}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


@dataclass
class Sheet:
    """Names and cells of a table, how it is written, and the record in it: u and y (N,) in SI as `signals` 1 and 2, Ts.

    `sure` says that it must be read; otherwise a sentence does as well. `loose` holds the samples that a repair may
    have given any value. `marked` says that thousands marks stand in it.
    """

    names: list[str]
    rows: list[list[str]]
    signals: dict[int, np.ndarray]
    Ts: float
    mark: str = ","
    end: str = "\n"
    head: list[str] = field(default_factory=list)
    below: list[str] | None = None
    encoding: str = "utf-8"
    sure: bool = True
    loose: set[int] = field(default_factory=set)
    marked: bool = False

    def content(self) -> bytes:
        """The file."""
        lines = [*self.head, self.mark.join(self.names)]
        lines += [] if self.below is None else [self.mark.join(self.below)]
        lines += [self.mark.join(row) for row in self.rows]
        return (self.end.join(lines) + self.end).encode(self.encoding)


def drawn(rng: np.random.Generator) -> Sheet:
    """A record of 20 to 40 samples in one of several layouts."""
    n, Ts = int(rng.integers(20, 41)), float(rng.choice([0.001, 0.01, 0.1, 0.5]))
    u = np.round(rng.uniform(-5, 5, n), int(rng.integers(1, 4)))
    y = np.round(np.cumsum(rng.uniform(-1, 1, n)), int(rng.integers(2, 5)))
    kinds = (list(TIMES), ["V", "mV", "kV"], ["deg", "rad", "rev"])
    unit_t, unit_u, unit_y = (str(rng.choice(kind)) for kind in kinds)
    t = np.arange(n) * Ts / TIMES[unit_t]
    names = [f"t [{unit_t}]", f"u [{unit_u}]", f"y [{unit_y}]"]
    cells = [[f"{round(value, 6):g}" if unit_t != "us" else f"{value:.0f}" for value in t]]
    cells += [[repr(float(value)) for value in values] for values in (u, y)]
    rows = [list(row) for row in zip(*cells, strict=True)]
    signals = {1: u * UNITS[unit_u], 2: y * UNITS[unit_y]}
    return Sheet(names, rows, signals, Ts, str(rng.choice([",", ";", "\t"])))


def _rows_swapped(rng: np.random.Generator, s: Sheet) -> None:
    j, k = (int(x) for x in rng.choice(len(s.rows), 2, replace=False))
    s.rows[j], s.rows[k] = s.rows[k], s.rows[j]
    s.sure = False


def _row_again(rng: np.random.Generator, s: Sheet) -> None:
    k = int(rng.integers(len(s.rows)))
    s.rows.insert(k, list(s.rows[k]))
    s.sure = False


def _row_gone(rng: np.random.Generator, s: Sheet) -> None:
    k = int(rng.integers(2, len(s.rows) - 2))
    del s.rows[k]
    s.loose.add(k)
    s.sure = False


def _thousands(rng: np.random.Generator, s: Sheet) -> None:
    """All cells of a signal times 1,000, as whole numbers with thousands marks of one kind."""
    j, mark = int(rng.integers(1, 3)), str(rng.choice([",", "'", " ", "_"]))
    raw = [round(float(row[j]) * 1000) for row in s.rows]
    for row, value in zip(s.rows, raw, strict=True):
        row[j] = _quoted(s, f"{value:,}".replace(",", mark))
    s.signals[j] = np.array(raw) * UNITS[_unit_of(s, j)]
    s.sure, s.marked = False, True


def _decimal_comma(rng: np.random.Generator, s: Sheet) -> None:
    k, j = int(rng.integers(len(s.rows))), int(rng.integers(3))
    s.rows[k][j] = _quoted(s, s.rows[k][j].replace(".", ","))
    s.sure = False


def _all_commas(rng: np.random.Generator, s: Sheet) -> None:
    if s.marked:
        return  # 1,234 may then be either
    s.mark = ";" if s.mark == "," else s.mark
    s.rows = [[cell.replace(".", ",") for cell in row] for row in s.rows]
    s.sure = s.sure and s.mark == ";"


def _name_gone(rng: np.random.Generator, s: Sheet) -> None:
    j = int(rng.integers(3))
    if s.below is not None:
        return
    if j:  # its unit goes with the name
        s.signals[j] = s.signals[j] / UNITS[_unit_of(s, j)]
    s.names[j] = ""
    s.sure = False


def _names_gone(rng: np.random.Generator, s: Sheet) -> None:
    """Without names a column has no unit: only what must be refused, or is in SI, is right."""
    s.names = s.rows[0]
    s.rows = s.rows[1:]
    s.sure = False


def _unit(rng: np.random.Generator, s: Sheet) -> None:
    """Another unit in the header: the numbers mean another thing."""
    j = int(rng.integers(1, 3))
    new = str(rng.choice(["V", "mV", "kV"] if j == 1 else ["deg", "rad", "rev", "mrad"]))
    s.signals[j] = s.signals[j] * (UNITS[new] / UNITS[_unit_of(s, j)])
    s.names[j] = f"{s.names[j].partition(' [')[0]} [{new}]"


def _units_below(rng: np.random.Generator, s: Sheet) -> None:
    if s.below is None and all(" [" in name for name in s.names):
        s.below = [name.rstrip("]").partition(" [")[2] for name in s.names]
        s.names = [name.partition(" [")[0] for name in s.names]


def _columns_moved(rng: np.random.Generator, s: Sheet) -> None:
    order = rng.permutation(len(s.names))
    s.names = [s.names[j] for j in order]
    s.below = None if s.below is None else [s.below[j] for j in order]
    s.rows = [[row[j] for j in order] for row in s.rows]


def _comment(rng: np.random.Generator, s: Sheet) -> None:
    s.head.insert(0, str(rng.choice(["# rig 7", "% of a Monday", "", "# a,b;c", '# qpal: {"joint": "thigh"}'])))


def _other_Ts(rng: np.random.Generator, s: Sheet) -> None:
    value = str(rng.choice(["1e9", "7", "-1", "0", '"x"', "null", "[1]", "true", "1e400"]))
    s.head.insert(0, f'# qpal: {{"Ts": {value}}}')
    s.sure = False


def _line_end(rng: np.random.Generator, s: Sheet) -> None:
    s.end = str(rng.choice(["\r\n", "\r", "\n"]))


def _encoded(rng: np.random.Generator, s: Sheet) -> None:
    s.encoding = str(rng.choice(["utf-8-sig", "utf-16", "utf-8"]))


def _quoted_all(rng: np.random.Generator, s: Sheet) -> None:
    s.rows = [['"' + cell.strip('"') + '"' for cell in row] for row in s.rows]


def _blanks(rng: np.random.Generator, s: Sheet) -> None:
    s.rows = [[f" {cell}" for cell in row] for row in s.rows]
    s.sure = s.sure and s.mark != "\t"  # tabs and blanks are white space together


def _no_value(rng: np.random.Generator, s: Sheet) -> None:
    k = int(rng.integers(1, len(s.rows) - 1))
    s.rows[k][int(rng.integers(1, 3))] = str(rng.choice(["", "NaN", "nan", "NA", "null", "-", "#N/A", "x", "inf"]))
    s.loose.add(k)
    s.sure = False


def _spelled(rng: np.random.Generator, s: Sheet) -> None:
    j = int(rng.integers(1, 3))
    for row in s.rows:
        row[j] = f"{float(row[j]):+.17e}"


def _trailing(rng: np.random.Generator, s: Sheet) -> None:
    s.rows = [[*row, ""] for row in s.rows]


def _more(rng: np.random.Generator, s: Sheet) -> None:
    """A column that nobody asked for."""
    word = str(rng.choice(["auto", "0", "7", "True", ""]))
    s.names.append(str(rng.choice(["mode", "status", "remark"])))
    s.below = None if s.below is None else [*s.below, ""]
    s.rows = [[*row, word] for row in s.rows]


def _unit_of(s: Sheet, j: int) -> str:
    return s.names[j].rstrip("]").partition(" [")[2]


def _quoted(s: Sheet, cell: str) -> str:
    return f'"{cell}"' if s.mark in cell else cell


Change = Callable[[np.random.Generator, Sheet], None]
CHANGES: tuple[Change, ...] = (  # in the order in which they are made
    *(_unit, _spelled, _thousands, _no_value, _row_gone, _row_again, _rows_swapped, _decimal_comma, _all_commas),
    *(_quoted_all, _blanks, _more, _units_below, _name_gone, _columns_moved, _names_gone, _trailing),
    *(_comment, _other_Ts, _line_end, _encoded),
)


def changed(rng: np.random.Generator) -> Sheet:
    """A drawn sheet after up to three changes."""
    sheet = drawn(rng)
    for k in sorted(rng.choice(len(CHANGES), int(rng.integers(0, 4)), replace=False)):
        CHANGES[k](rng, sheet)
    return sheet

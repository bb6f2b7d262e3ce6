"""Columns whose cells hold complex numbers, as a circuit simulator exports them: two columns of numbers instead.

LTspice writes "1.0e+01<tab>(-3.01e+00dB,-4.5e+01°)" or, as Cartesian, "1.0e+01<tab>9.9e-01,-1.0e-02" below a head
"Freq.<tab>V(out)"; its frequencies are in Hz (LTspice Help, Waveform Viewer, Exporting Waveform Data).
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.data.table import Table

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_FORMS = {  # both columns by the end of their names and their units
    (("magnitude", "dB"), ("phase", "deg")): re.compile(rf"\(\s*{_NUMBER}\s*dB\s*,\s*{_NUMBER}\s*(?:°|º|deg)?\s*\)"),
    (("real", ""), ("imag", "")): re.compile(rf"\(?\s*{_NUMBER}\s*,\s*{_NUMBER}\s*\)?"),
}
_FREQUENCY = "Freq."  # of LTspice


def with_parts(table: Table) -> Table:
    """The table with two columns in place of each of complex numbers; as it is where it has none."""
    parts: list[tuple[str, str, Any, Sequence[int]]] = []
    for name, column, rows in zip(table.names, table.columns, table.rows, strict=True):
        unit = table.units.get(name, "Hz" if name == _FREQUENCY else "")
        pair = [] if isinstance(column, np.ndarray) else _parts(name, column)
        parts += [(*part, rows) for part in pair] or [(name, unit, column, rows)]
    if len(parts) == len(table.names):
        return table
    names, units, columns, places = zip(*parts, strict=True)
    known = {name: unit for name, unit in zip(names, units, strict=True) if unit}
    return replace(table, names=names, columns=columns, rows=places, units=known)


def _parts(name: str, cells: Sequence[str]) -> list[tuple[str, str, np.ndarray]]:
    """Name, unit and numbers of both columns of a column of texts that all have one form; none of another column."""
    for both, form in _FORMS.items():
        if not len(cells) or not form.fullmatch(cells[0].strip()):
            continue
        matches = [form.fullmatch(cell.strip()) for cell in cells]
        if all(matches):
            values = np.array([[float(match[1]), float(match[2])] for match in matches if match])
            return [(f"{name} {end}", unit, values[:, k]) for k, (end, unit) in enumerate(both)]
    return []
